#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "config/rig.h"
#include "core/result.h"

struct libusb_context;
struct libusb_device_handle;

namespace lightrig {

/// A byte stream to a USB CDC-ACM device through libusb [USB CDC PSTN 1.2]: opened by
/// VID:PID:serial, endpoints taken from the descriptors, line coding set, kernel driver detached
/// and given back.
class CdcAcm {
 public:
  /// A device that is just being plugged in is waited for, a few seconds. Errors: not_found (with
  /// what was seen), refused (no permission, several alike, claimed elsewhere).
  static Result<CdcAcm> open(const UsbEndpoint& endpoint);
  CdcAcm(CdcAcm&&) noexcept;
  CdcAcm& operator=(CdcAcm&&) noexcept;
  ~CdcAcm();

  /// As SerialPort's. One transfer waits at the device all the time: a look at what has come, with
  /// no patience, costs no wait.
  Result<std::string> read_some(std::chrono::milliseconds patience);
  Result<void> write_all(std::string_view bytes, std::chrono::milliseconds patience);

 private:
  struct CloseContext {
    void operator()(libusb_context* context) const;
  };
  struct Inbound;
  CdcAcm();
  Result<void> ask_for_bytes();
  void call_back();
  Result<void> find(const UsbEndpoint& endpoint);
  bool arrives(const UsbEndpoint& endpoint);
  void clear_halt(std::uint8_t endpoint);
  Result<void> read_descriptors();
  Result<void> configure_line(int baud);
  void give_back();

  std::unique_ptr<libusb_context, CloseContext> context_;
  libusb_device_handle* handle_ = nullptr;
  std::unique_ptr<Inbound> inbound_;  ///< made at the first read
  int control_interface_ = -1, data_interface_ = -1;
  std::uint8_t bulk_in_ = 0, bulk_out_ = 0;
  int packet_ = 64;  ///< [byte] of the bulk IN endpoint
  std::string name_;
};

}  // namespace lightrig
