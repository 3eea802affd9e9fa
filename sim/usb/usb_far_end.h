#pragma once

#include <memory>
#include <string>

#include "config/rig.h"
#include "core/result.h"
#include "sim/usb/grbl_far_end.h"

namespace lightrig::sim {

/// A CDC-ACM device below the system call interface: sysfs, device node and usbfs of a test bed, in
/// which a program that was started with the right environment finds it as it would find a real
/// one. Control, bulk and cancelled transfers, STALL, NAK, unplugging and plugging in again; the
/// bytes are a GRBL controller's. A kernel driver (cdc_acm) holds its interfaces until it is
/// detached.
class UsbFarEnd {
 public:
  /// Errors: refused (no test bed to be had).
  static Result<std::unique_ptr<UsbFarEnd>> open(const UsbEndpoint& endpoint, GrblFarEnd far_end);
  ~UsbFarEnd();
  UsbFarEnd(const UsbFarEnd&) = delete;
  UsbFarEnd& operator=(const UsbFarEnd&) = delete;

  /// The folder that UMOCKDEV_DIR must name.
  std::string folder() const;
  /// What happened to the device, a line each: "plugged in", "claimed 0", "line state 3", …
  std::string history() const;

 private:
  class Device;
  explicit UsbFarEnd(std::unique_ptr<Device> device);
  std::unique_ptr<Device> device_;
};

}  // namespace lightrig::sim
