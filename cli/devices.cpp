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

// A rig's own devices, each opened whatever became of the others, and what speaks against the rig.
std::vector<TriedDevice> try_rig(const std::string& path, std::vector<std::string>& problems) {
  const RigFiles files = read_rig_files(path, "");
  show_diagnostics(files);
  if (!files.valid()) {
    problems.push_back(fmt::format("{} is no valid rig file: lightrig check shows why", path));
    return {};
  }
  RealClock clock;
  std::vector<TriedDevice> tried = try_devices(*files.rig.value, clock);
  for (const TriedDevice& one : tried)
    if (!one.problem.empty()) problems.push_back(one.problem);
  return tried;
}

std::string found_words(const std::vector<Found>& found, bool looked_for_cameras) {
  if (found.empty())
    return looked_for_cameras ? "no serial port, no USB device and no camera is there"
                              : "no serial port and no USB device is there";
  std::vector<std::vector<std::string>> rows;
  for (const Found& one : found)
    rows.push_back({one.kind + "  " + one.name, one.what,
                    one.obstacle.empty() ? "can be opened" : one.obstacle});
  return table({"device", "what it says", "opening it"}, rows);
}

std::string tried_words(const std::vector<TriedDevice>& tried) {
  std::vector<std::vector<std::string>> rows;
  for (const TriedDevice& one : tried)
    rows.push_back({one.device, one.answer, one.problem.empty() ? "answers" : "does not open"});
  return table({"of the rig", "what it says", "opening it"}, rows);
}

}  // namespace

int devices(const DevicesOptions& options) {
  std::vector<Found> found = serial_ports();
  for (Found& one : usb_devices()) found.push_back(std::move(one));
  std::string not_looked;
  for (Found& one : cameras(not_looked)) found.push_back(std::move(one));
  std::vector<std::string> of_the_rig;
  std::vector<TriedDevice> tried;
  if (!options.rig.empty()) tried = try_rig(options.rig, of_the_rig);
  if (options.json) {
    Json list = Json::array(), opened = Json::array(), problems = Json::array();
    for (const Found& one : found)
      list.push_back(
          {{"kind", one.kind}, {"name", one.name}, {"what", one.what}, {"obstacle", one.obstacle}});
    for (const TriedDevice& one : tried)
      opened.push_back(
          {{"device", one.device}, {"what", one.answer}, {"opened", one.problem.empty()}});
    if (!not_looked.empty()) problems.push_back(not_looked);
    for (const std::string& problem : of_the_rig) problems.push_back(problem);
    Json json{{"devices", std::move(list)}, {"problems", std::move(problems)}};
    if (!options.rig.empty()) json["rig"] = std::move(opened);
    say(json_text(json));
  } else {
    say(found_words(found, not_looked.empty()));
    if (!not_looked.empty()) say(not_looked);
    if (!tried.empty()) say(tried_words(tried));
  }
  for (const std::string& problem : of_the_rig) complain(problem);
  return of_the_rig.empty() ? 0 : 1;
}

}  // namespace lightrig::cli
