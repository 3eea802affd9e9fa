#include "sim/usb/usb_descriptors.h"

namespace lightrig::sim {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::size_t device_bytes = 18;
constexpr int type_device = 1, type_configuration = 2, type_string = 3;
constexpr std::uint8_t english = 0x09;

std::uint8_t low(int word) { return static_cast<std::uint8_t>(word & 0xff); }
std::uint8_t high(int word) { return static_cast<std::uint8_t>((word >> 8) & 0xff); }

Bytes string_descriptor(const std::string& text) {
  Bytes bytes{static_cast<std::uint8_t>(2 + 2 * text.size()), type_string};
  for (const char c : text) {
    bytes.push_back(static_cast<std::uint8_t>(c));
    bytes.push_back(0);
  }
  return bytes;
}

}  // namespace

Bytes usb_descriptors(const UsbIdentity& id) {
  const auto packet = static_cast<std::uint8_t>(usb_packet);
  Bytes all{18,
            1,
            0x00,
            0x02,
            0x02,
            0,
            0,
            packet,
            low(id.vendor),
            high(id.vendor),
            low(id.product),
            high(id.product),
            0x00,
            0x01,
            1,
            2,
            static_cast<std::uint8_t>(id.serial.empty() ? 0 : 3),
            1};
  const Bytes configuration{9,    2,      67,
                            0,    2,      1,
                            0,    0x80,   50,  // two interfaces
                            9,    4,      0,
                            0,    1,      0x02,
                            0x02, 0x01,   0,  // communications, ACM, AT commands
                            5,    0x24,   0x00,
                            0x10, 0x01,  // header, CDC 1.10
                            5,    0x24,   0x01,
                            0x00, 1,  // call management: none
                            4,    0x24,   0x02,
                            0x02,  // line coding and state
                            5,    0x24,   0x06,
                            0,    1,  // union of both interfaces
                            7,    5,      usb_notify_endpoint,
                            3,    8,      0,
                            16,  // interrupt IN
                            9,    4,      1,
                            0,    2,      0x0a,
                            0,    0,      0,  // data
                            7,    5,      usb_out_endpoint,
                            2,    packet, 0,
                            0,  // bulk OUT, not number 1
                            7,    5,      usb_in_endpoint,
                            2,    packet, 0,
                            0};  // bulk IN
  all.insert(all.end(), configuration.begin(), configuration.end());
  return all;
}

Bytes usb_descriptor(const UsbIdentity& id, int value) {
  const int type = value >> 8, index = value & 0xff;
  const Bytes all = usb_descriptors(id);
  if (type == type_device) return {all.begin(), all.begin() + device_bytes};
  if (type == type_configuration) return {all.begin() + device_bytes, all.end()};
  if (type != type_string) return {};
  if (index == 0) return {4, type_string, english, 0x04};
  if (index == 1) return string_descriptor(id.manufacturer);
  if (index == 2) return string_descriptor(id.name);
  if (index == 3 && !id.serial.empty()) return string_descriptor(id.serial);
  return {};
}

}  // namespace lightrig::sim
