#include "sim/hosted_rig.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <iterator>
#include <type_traits>

#include "sim/open_devices.h"
#include "sim/world.h"

namespace lightrig::sim {
namespace {

using Hosted = Result<std::vector<HostedWire>>;

// The overloads for parts without a wire of their own stand here, beside the dispatch. A lamp on an
// output of the gantry's controller comes with the gantry; fixed lamps hang on the lamp's wire.
template <class NoWire>
Hosted host_wire(const Rig&, const NoWire&, const std::shared_ptr<World>&,
                 const std::shared_ptr<WireFaults>&) requires
    std::is_same_v<NoWire, SimulatedGantry> || std::is_same_v<NoWire, SimulatedLamp> ||
    std::is_same_v<NoWire, GantryLamp> || std::is_same_v<NoWire, FixedLampsGantry> {
  return std::vector<HostedWire>{};
}

tl::unexpected<Error> bad(std::string message) {
  return fail(ErrorCode::invalid_input, std::move(message));
}

std::vector<std::string_view> words_of(std::string_view line) {
  std::vector<std::string_view> words;
  while (true) {
    const std::size_t begin = line.find_first_not_of(" \t\r");
    if (begin == std::string_view::npos) return words;
    line.remove_prefix(begin);
    words.push_back(line.substr(0, line.find_first_of(" \t\r")));
    line.remove_prefix(words.back().size());
  }
}

/// A camera's fault; without a frame it strikes at the next.
struct CameraFaultLine {
  CameraFault fault;
  bool next = true;
};

Result<CameraFaultLine> parse_camera_fault(CameraFaultKind kind,
                                           const std::vector<std::string_view>& words) {
  CameraFaultLine line;
  line.fault.kind = kind;
  for (std::size_t i = 1; i < words.size(); ++i) {
    const std::string_view word = words[i];
    const std::string value(word.substr(std::min(word.size(), word.find('=') + 1)));
    char* end = nullptr;
    const double number = std::strtod(value.c_str(), &end);
    const bool sound = !value.empty() && *end == '\0';
    if (word.starts_with("frame=") && sound && number >= 1 && number == std::floor(number)) {
      line.fault.nth_frame = static_cast<std::uint64_t>(number);
      line.next = false;
    } else if (word.starts_with("seconds=") && sound && number >= 0) {
      line.fault.seconds = number;
    } else if (word != "wire=camera") {
      return bad(fmt::format(
          "\"{}\" is not understood; a camera's fault reads: KIND [frame=N] [seconds=S]", word));
    }
  }
  return line;
}

/// Packets lost at random, from now on.
Result<void> add_loss(CameraWireFaults& faults, const std::vector<std::string_view>& words) {
  double share = -1;
  bool resend = true;
  std::uint64_t seed = 1;
  for (std::size_t i = 1; i < words.size(); ++i) {
    const std::string_view word = words[i];
    const std::string value(word.substr(std::min(word.size(), word.find('=') + 1)));
    char* end = nullptr;
    const double number = std::strtod(value.c_str(), &end);
    const bool sound = !value.empty() && *end == '\0' && number >= 0;
    if (word.starts_with("share=") && sound && number <= 1)
      share = number;
    else if (word.starts_with("seed=") && sound && number == std::floor(number))
      seed = static_cast<std::uint64_t>(number);
    else if (word == "resend=yes" || word == "resend=no")
      resend = word == "resend=yes";
    else if (word != "wire=camera")
      return bad(
          fmt::format("\"{}\" is not understood; a loss reads: loss share=S "
                      "[resend=yes|no] [seed=N]",
                      word));
  }
  if (share < 0) return bad("a loss needs its share, from 0 to 1: loss share=0.01");
  faults.lose(share, resend, seed);
  return {};
}

}  // namespace

Result<void> HostedRig::add_fault(std::string_view text) {
  const std::vector<std::string_view> words = words_of(text);
  if (!words.empty() && words.front() == "loss") return add_loss(*camera_faults, words);
  const auto kind = words.empty() ? std::nullopt : camera_fault_kind(words.front());
  if (!kind) {
    auto fault = parse_wire_fault(text);
    if (!fault) return tl::unexpected(fault.error());
    return faults->add(std::move(*fault));
  }
  const auto line = parse_camera_fault(*kind, words);
  if (!line) return tl::unexpected(line.error());
  if (line->next)
    camera_faults->add_next(*kind, line->fault.seconds);
  else
    camera_faults->add(line->fault);
  return {};
}

Result<void> HostedRig::add_faults(const std::string& text, const std::string& file) {
  int number = 0;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    std::string_view line(text.data() + begin, end - begin);
    begin = end + 1;
    ++number;
    line = line.substr(0, line.find('#'));
    if (words_of(line).empty()) continue;
    if (auto added = add_fault(line); !added)
      return bad(fmt::format("{}:{}: error: {}", file, number, added.error().message));
  }
  return {};
}

std::vector<std::string> HostedRig::struck() const {
  std::vector<std::string> all = faults->struck();
  for (const CameraFault& fault : camera_faults->struck())
    all.push_back(
        fmt::format("{} on the camera's wire at frame {}", name_of(fault.kind), fault.nth_frame));
  if (camera_faults->packets_lost() > 0) all.emplace_back("loss on the camera's wire");
  return all;
}

std::map<std::string, std::string> HostedRig::environment() const {
  std::map<std::string, std::string> all;
  for (const HostedWire& wire : wires)
    for (const auto& [name, value] : wire.environment) all[name] = value;
  return all;
}

Result<HostedRig> host_rig(const Rig& rig, const ObjectConfig& object, std::uint64_t seed) {
  if (!rig.simulation)
    return fail(ErrorCode::invalid_input,
                fmt::format("{} has no [simulation] table, so there is nothing to simulate it by",
                            rig.path.string()));
  HostedRig hosted;
  hosted.clock = std::make_unique<RealClock>();
  auto world = make_world(rig, object, *hosted.clock, seed);
  if (!world) return tl::unexpected(world.error());
  hosted.world = std::move(*world);
  hosted.faults = std::make_shared<WireFaults>(hosted.world);
  const auto host = [&](const auto& backend) {
    return host_wire(rig, backend, hosted.world, hosted.faults);
  };
  hosted.camera_faults = std::make_shared<CameraWireFaults>();
  const auto* camera = std::get_if<AravisCamera>(&rig.camera.backend);
  for (Hosted wires :
       {std::visit(host, rig.gantry.backend), std::visit(host, rig.lamp.backend),
        camera ? host_wire(rig, *camera, hosted.world, hosted.camera_faults) : Hosted{}}) {
    if (!wires) return tl::unexpected(wires.error());
    std::move(wires->begin(), wires->end(), std::back_inserter(hosted.wires));
  }
  if (hosted.wires.empty())
    return fail(ErrorCode::refused,
                fmt::format("{} names no hardware, so there is no wire to be at the far end of; "
                            "lightrigd --simulate runs it in memory",
                            rig.path.string()));
  return hosted;
}

}  // namespace lightrig::sim
