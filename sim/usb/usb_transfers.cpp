// Transfers: carried out at once, or when the far end has something to say, and shown as ready.
#include <fmt/format.h>
#include <linux/usbdevice_fs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>

#include "sim/usb/usb_device.h"

namespace lightrig::sim {
namespace {

constexpr std::uint8_t get_descriptor = 6, set_line_coding = 0x20, get_line_coding = 0x21,
                       set_control_line_state = 0x22;

}  // namespace

void UsbFarEnd::Device::release(const Urb& urb) {
  if (urb.buffer) umockdev_ioctl_data_unref(urb.buffer);
  if (urb.urb) umockdev_ioctl_data_unref(urb.urb);
}

// Writable while there is something to reap, or the device is gone.
void UsbFarEnd::Device::show_readiness() {
  if (readiness_ < 0) return;
  const bool ready = !done_.empty() || !plugged_;
  if (ready == !full_) return;
  std::array<char, fifo_page> bytes{};
  if (ready) {
    while (read(readiness_, bytes.data(), bytes.size()) > 0) {
    }
  } else {
    while (write(readiness_, bytes.data(), bytes.size()) > 0) {
    }
  }
  full_ = !ready;
}

void UsbFarEnd::Device::finish(Urb urb, int status, const std::string* bytes, int length) {
  if (bytes && urb.buffer && !bytes->empty()) {
    std::vector<guint8> copy(bytes->begin(), bytes->end());
    const std::size_t from = urb.type == USBDEVFS_URB_TYPE_CONTROL ? usb_setup_bytes : 0;
    umockdev_ioctl_data_update(urb.buffer, from, copy.data(), static_cast<gint>(copy.size()));
  }
  const auto put = [&](std::size_t offset, int value) {
    std::array<guint8, sizeof(int)> raw{};
    std::memcpy(raw.data(), &value, sizeof value);
    umockdev_ioctl_data_update(urb.urb, offset, raw.data(), static_cast<gint>(raw.size()));
  };
  put(offsetof(usbdevfs_urb, status), status);
  put(offsetof(usbdevfs_urb, actual_length), length);
  done_.push_back(urb);
  show_readiness();
}

void UsbFarEnd::Device::control(Urb urb) {
  const auto* setup = urb.buffer->data;
  const int request = setup[1], value = setup[2] | (setup[3] << 8),
            wanted = setup[6] | (setup[7] << 8);
  const std::string data(setup + usb_setup_bytes, setup + urb.length);
  std::string answer;
  bool stall = false;
  if (setup[0] == 0x80 && request == get_descriptor) {
    const auto bytes = usb_descriptor(identity_, value);
    answer.assign(bytes.begin(), bytes.end());
    stall = bytes.empty();
  } else if (setup[0] == 0x21 && request == set_line_coding && wanted == 7) {
    std::copy_n(data.begin(), 7, line_.begin());
    const auto rate = static_cast<std::uint32_t>(line_[0] | (line_[1] << 8) | (line_[2] << 16)) |
                      (std::uint32_t{line_[3]} << 24);
    note(fmt::format("line {} baud, {} data bits, parity {}, stop {}", rate, line_[6], line_[5],
                     line_[4]));
    return finish(urb, 0, nullptr, 7);
  } else if (setup[0] == 0xa1 && request == get_line_coding) {
    answer.assign(line_.begin(), line_.end());
  } else if (setup[0] == 0x21 && request == set_control_line_state) {
    note(fmt::format("line state {}", value));
  } else {
    stall = true;
  }
  if (stall) return finish(urb, -EPIPE, nullptr, 0);
  answer.resize(std::min(answer.size(), static_cast<std::size_t>(wanted)));
  finish(urb, 0, &answer, static_cast<int>(answer.size()));
}

void UsbFarEnd::Device::bulk_out(Urb urb) {
  if (halted_out_) return finish(urb, -EPIPE, nullptr, 0);
  const auto* bytes = urb.buffer ? urb.buffer->data : nullptr;
  const auto length = static_cast<std::size_t>(urb.length);
  far_end_.receive({reinterpret_cast<const char*>(bytes), length});
  finish(urb, 0, nullptr, urb.length);
}

// Bytes go to the oldest transfer that waits for some.
void UsbFarEnd::Device::feed_bulk_in() {
  for (auto urb = waiting_.begin(); urb != waiting_.end();) {
    const bool in = urb->endpoint == usb_in_endpoint;
    if (!in || (!halted_in_ && !far_end_.has_something_to_say())) {
      ++urb;
      continue;
    }
    const Urb one = *urb;
    urb = waiting_.erase(urb);
    if (halted_in_) {
      finish(one, -EPIPE, nullptr, 0);
      continue;
    }
    const std::string bytes = far_end_.take(static_cast<std::size_t>(one.length));
    finish(one, 0, &bytes, static_cast<int>(bytes.size()));
  }
}

}  // namespace lightrig::sim
