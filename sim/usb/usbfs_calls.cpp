// What a program asks of usbfs [linux/usbdevice_fs.h], answered as the kernel would.
#include <fmt/format.h>
#include <linux/usbdevice_fs.h>
#include <sys/ioctl.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>

#include "sim/usb/usb_device.h"

namespace lightrig::sim {
namespace {

using std::chrono::steady_clock;

constexpr std::uint32_t capabilities = USBDEVFS_CAP_ZERO_PACKET | USBDEVFS_CAP_BULK_CONTINUATION |
                                       USBDEVFS_CAP_NO_PACKET_SIZE_LIM |
                                       USBDEVFS_CAP_REAP_AFTER_DISCONNECT;

}  // namespace

long UsbFarEnd::Device::submit(UMockdevIoctlClient* client, UMockdevIoctlData* data, int& error) {
  Urb urb;
  urb.client = client;
  usbdevfs_urb fields{};
  std::memcpy(&fields, data->data, sizeof fields);
  urb.type = fields.type;
  urb.endpoint = fields.endpoint;
  urb.length = fields.buffer_length;
  urb.address = data->client_addr;
  if (urb.length > 0) {
    urb.buffer = umockdev_ioctl_data_resolve(data, offsetof(usbdevfs_urb, buffer),
                                             static_cast<gsize>(urb.length), nullptr);
    if (!urb.buffer) return error = EFAULT, -1;
  }
  urb.urb = umockdev_ioctl_data_ref(data);
  if (urb.type == USBDEVFS_URB_TYPE_CONTROL) {
    if (urb.buffer && urb.length >= static_cast<int>(usb_setup_bytes))
      control(urb);
    else
      finish(urb, -EPIPE, nullptr, 0);
  } else if (urb.endpoint == usb_out_endpoint && steady_clock::now() >= nak_until_) {
    bulk_out(urb);
    feed_bulk_in();
  } else {
    waiting_.push_back(urb);
    if (steady_clock::now() >= nak_until_) feed_bulk_in();
  }
  return 0;
}

long UsbFarEnd::Device::reap(UMockdevIoctlData* data, int& error) {
  if (done_.empty()) return error = plugged_ ? EAGAIN : ENODEV, -1;
  const Urb urb = done_.front();
  done_.pop_front();
  umockdev_ioctl_data_set_ptr(data, 0, urb.urb);
  release(urb);
  show_readiness();
  return 0;
}

long UsbFarEnd::Device::discard(gulong address, int& error) {
  const auto found = std::find_if(waiting_.begin(), waiting_.end(),
                                  [&](const Urb& urb) { return urb.address == address; });
  if (found == waiting_.end()) return error = EINVAL, -1;
  const Urb urb = *found;
  waiting_.erase(found);
  note(fmt::format("transfer taken back at {:#04x}", urb.endpoint));
  finish(urb, -ENOENT, nullptr, 0);
  return 0;
}

long UsbFarEnd::Device::claim(unsigned interface, int& error) {
  if (interface >= kernel_driver_.size()) return error = ENOENT, -1;
  if (kernel_driver_[interface]) return error = EBUSY, -1;
  note(fmt::format("claimed {}", interface));
  return 0;
}

// USBDEVFS_IOCTL: what libusb detaches and attaches a kernel driver by.
long UsbFarEnd::Device::driver_command(UMockdevIoctlData* data, int& error) {
  usbdevfs_ioctl command{};
  std::memcpy(&command, data->data, sizeof command);
  const auto interface = static_cast<std::size_t>(command.ifno);
  if (interface >= kernel_driver_.size()) return error = ENOENT, -1;
  const bool attach = command.ioctl_code == static_cast<int>(USBDEVFS_CONNECT);
  if (!attach && command.ioctl_code != static_cast<int>(USBDEVFS_DISCONNECT))
    return error = ENOTTY, -1;
  if (!attach && !kernel_driver_[interface]) return error = ENODATA, -1;
  if (attach && kernel_driver_[interface]) return error = EBUSY, -1;
  kernel_driver_[interface] = attach;
  note(fmt::format("kernel driver {} {}", attach ? "attached to" : "detached from", interface));
  return attach ? 1 : 0;
}

long UsbFarEnd::Device::obey(UMockdevIoctlClient* client, int& error) {
  const gulong request = umockdev_ioctl_client_get_request(client);
  UMockdevIoctlData* arg = umockdev_ioctl_client_get_arg(client);
  if (!plugged_ && request != USBDEVFS_REAPURBNDELAY && request != USBDEVFS_REAPURB)
    return error = ENODEV, -1;
  if (request == USBDEVFS_DISCARDURB) {
    gulong address = 0;
    std::memcpy(&address, arg->data, sizeof address);
    return discard(address, error);
  }
  const gsize size = _IOC_SIZE(request);
  UMockdevIoctlData* data = size > 0 ? umockdev_ioctl_data_resolve(arg, 0, size, nullptr) : nullptr;
  if (size > 0 && !data) return error = EFAULT, -1;
  const auto number = [&] {
    unsigned value = 0;
    std::memcpy(&value, data->data, sizeof value);
    return value;
  };
  switch (request) {
    case USBDEVFS_GET_CAPABILITIES: {
      std::array<guint8, sizeof capabilities> raw{};
      std::memcpy(raw.data(), &capabilities, sizeof capabilities);
      umockdev_ioctl_data_update(data, 0, raw.data(), static_cast<gint>(raw.size()));
      return 0;
    }
    case USBDEVFS_CLAIMINTERFACE:
      return claim(number(), error);
    case USBDEVFS_RELEASEINTERFACE:
      note(fmt::format("released {}", number()));
      return 0;
    case USBDEVFS_CLEAR_HALT: {
      (number() == usb_in_endpoint ? halted_in_ : halted_out_) = false;
      note(fmt::format("halt cleared at {:#04x}", number()));
      return 0;
    }
    case USBDEVFS_GETDRIVER: {
      const unsigned interface = number();
      if (interface >= kernel_driver_.size() || !kernel_driver_[interface])
        return error = ENODATA, -1;
      constexpr std::string_view name = "cdc_acm";
      std::vector<guint8> raw(name.begin(), name.end());
      raw.push_back(0);
      umockdev_ioctl_data_update(data, offsetof(usbdevfs_getdriver, driver), raw.data(),
                                 static_cast<gint>(raw.size()));
      return 0;
    }
    case USBDEVFS_IOCTL:
      return driver_command(data, error);
    case USBDEVFS_SETINTERFACE:
    case USBDEVFS_SETCONFIGURATION:
    case USBDEVFS_RESETEP:
      return 0;
    case USBDEVFS_SUBMITURB:
      return submit(client, data, error);
    case USBDEVFS_REAPURB:
    case USBDEVFS_REAPURBNDELAY:
      return reap(data, error);
    default:
      return error = ENOTTY, -1;
  }
}

gboolean UsbFarEnd::Device::on_ioctl(UMockdevIoctlBase*, UMockdevIoctlClient* client,
                                     gpointer self) {
  auto* device = static_cast<Device*>(self);
  int error = 0;
  long result = 0;
  {
    const std::lock_guard lock(device->mutex_);
    result = device->obey(client, error);
  }
  umockdev_ioctl_client_complete(client, result, error);
  return TRUE;
}

// A program that ends with transfers under way takes none of them back.
void UsbFarEnd::Device::on_vanished(UMockdevIoctlBase*, UMockdevIoctlClient* client,
                                    gpointer self) {
  auto* device = static_cast<Device*>(self);
  const std::lock_guard lock(device->mutex_);
  for (std::deque<Urb>* urbs : {&device->waiting_, &device->done_})
    std::erase_if(*urbs, [&](const Urb& urb) {
      if (urb.client != client) return false;
      release(urb);
      return true;
    });
  device->show_readiness();
}

}  // namespace lightrig::sim
