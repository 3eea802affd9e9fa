#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace lightrig::sim {

/// What a USB CDC-ACM device says of itself [USB 2.0, 9.6; USB CDC 1.2; PSTN 1.2].
struct UsbIdentity {
  int vendor = 0, product = 0;
  std::string serial, manufacturer = "lightrig", name = "simulated GRBL controller";
};

constexpr std::uint8_t usb_notify_endpoint = 0x83, usb_in_endpoint = 0x81, usb_out_endpoint = 0x02;
constexpr int usb_packet = 64;

/// The 18 bytes of the device, then its configuration, as sysfs' `descriptors` has them.
std::vector<std::uint8_t> usb_descriptors(const UsbIdentity& identity);

/// The answer to GET_DESCRIPTOR (`value` as in the request); empty: STALL.
std::vector<std::uint8_t> usb_descriptor(const UsbIdentity& identity, int value);

}  // namespace lightrig::sim
