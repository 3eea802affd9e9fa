#pragma once

#include <string>
#include <vector>

#include "config/file_descriptor.h"
#include "config/rig.h"
#include "core/result.h"

namespace lightrig {

/// Where the real devices of a rig are reached, each once, as in "modbus 192.168.1.5:502",
/// "serial /dev/ttyUSB0" (links followed), "usb 1a86:7523 SERIAL", "camera 192.168.10.30". What is
/// named in two ways (a camera's address and its serial number) counts as two.
std::vector<std::string> endpoints_of(const Rig& rig);

/// The devices of a rig claimed for as long as this lives, whatever its rig file is called: a copy
/// of the file is the same rig. Claims are names in the abstract socket namespace, so they need no
/// folder, no right, and go with the process.
class DeviceClaims {
 public:
  /// Errors: refused, naming device and process, where another process has claimed one.
  static Result<DeviceClaims> take(const Rig& rig);

 private:
  std::vector<FileDescriptor> held_;
};

}  // namespace lightrig
