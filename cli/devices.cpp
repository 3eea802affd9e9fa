// devices: what is plugged in, and what keeps it from being opened.
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "cli/json_fields.h"
#include "cli/rig_files.h"
#include "cli/say.h"
#include "cli/verbs.h"
#include "config/json_text.h"
#include "drivers/devices.h"

namespace lightrig::cli {
namespace {

namespace fs = std::filesystem;

struct Found {
  std::string kind, name, what, obstacle;
};

std::string first_line(const fs::path& path) {
  std::ifstream in(path);
  std::string line;
  std::getline(in, line);
  return line;
}

std::vector<fs::path> entries(const fs::path& folder) {
  std::vector<fs::path> all;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) all.push_back(entry.path());
  std::sort(all.begin(), all.end());
  return all;
}

// Why this user cannot open a node, and what to do; "" when it can.
std::string obstacle(const fs::path& node, const char* group) {
  if (access(node.c_str(), R_OK | W_OK) == 0) return {};
  if (errno == EACCES)
    return fmt::format("no permission: add the user to group {} and log in again", group);
  return std::strerror(errno);
}

// Ports with a device behind them: the kernel lists 32 empty 8250 ports on many machines.
std::vector<Found> serial_ports() {
  std::vector<Found> found;
  for (const fs::path& port : entries("/sys/class/tty")) {
    std::error_code error;
    const fs::path driver = fs::canonical(port / "device" / "driver", error);
    if (error || driver.filename() == "serial8250" || driver.filename() == "port") continue;
    const fs::path node = fs::path("/dev") / port.filename();
    found.push_back(
        {"serial", node.string(), driver.filename().string(), obstacle(node, "dialout")});
  }
  return found;
}

std::vector<Found> usb_devices() {
  std::vector<Found> found;
  for (const fs::path& device : entries("/sys/bus/usb/devices")) {
    const std::string vendor = first_line(device / "idVendor");
    if (vendor.empty() || first_line(device / "bDeviceClass") == "09") continue;  // 09: hubs
    const std::string bus = first_line(device / "busnum"), number_ = first_line(device / "devnum");
    const fs::path node = fmt::format("/dev/bus/usb/{:0>3}/{:0>3}", bus, number_);
    const std::string serial = first_line(device / "serial");
    found.push_back({"usb",
                     fmt::format("{}:{}{}", vendor, first_line(device / "idProduct"),
                                 serial.empty() ? "" : " serial " + serial),
                     first_line(device / "manufacturer") + " " + first_line(device / "product"),
                     obstacle(node, "plugdev (the shipped udev rule does it)")});
  }
  return found;
}

// Cameras are asked for by broadcast; none is opened. What kept them from being asked goes to
// `problem`: not finding is not the same as not being able to look.
std::vector<Found> cameras(std::string& problem) {
  std::vector<Found> found;
  const auto answered = find_cameras();
  if (!answered) {
    problem = answered.error().code == ErrorCode::not_built
                  ? "cameras: not in this build: " + answered.error().message
                  : "cameras: " + answered.error().message;
    return found;
  }
  for (const FoundCamera& camera : *answered)
    found.push_back({"camera", camera.address,
                     fmt::format("{} serial {}", camera.id, camera.serial), camera.obstacle});
  return found;
}

// A rig's own devices are opened and given back: nothing moves, no lamp is lit.
int try_rig(const std::string& path) {
  const RigFiles files = read_rig_files(path, "");
  show_diagnostics(files);
  if (!files.valid()) return 1;
  RealClock clock;
  const auto opened = open_devices(*files.rig.value, clock);
  if (!opened) return complain(with_context("open the rig's devices", opened.error()));
  say(fmt::format("the rig's gantry, lamp and camera ({}) answer", opened->camera->identity()));
  return 0;
}

}  // namespace

int devices(const DevicesOptions& options) {
  std::vector<Found> found = serial_ports();
  for (Found& one : usb_devices()) found.push_back(std::move(one));
  std::string problem;
  for (Found& one : cameras(problem)) found.push_back(std::move(one));
  if (options.json) {
    Json list = Json::array();
    for (const Found& one : found)
      list.push_back(
          {{"kind", one.kind}, {"name", one.name}, {"what", one.what}, {"obstacle", one.obstacle}});
    say(json_text(Json{{"devices", std::move(list)},
                       {"problems", problem.empty() ? Json::array() : Json::array({problem})}}));
  } else {
    std::vector<std::vector<std::string>> rows;
    for (const Found& one : found)
      rows.push_back({one.kind + "  " + one.name, one.what,
                      one.obstacle.empty() ? "can be opened" : one.obstacle});
    if (rows.empty())
      say(problem.empty() ? "no serial port, no USB device and no camera is there"
                          : "no serial port and no USB device is there");
    else
      say(table({"device", "what it says", "opening it"}, rows));
    if (!problem.empty()) say(problem);
  }
  return options.rig.empty() ? 0 : try_rig(options.rig);
}

}  // namespace lightrig::cli
