#include "drivers/usb/cdc_acm.h"

#include <fmt/format.h>
#include <libusb-1.0/libusb.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <thread>
#include <utility>
#include <vector>

#include "drivers/write_within.h"

namespace lightrig {
namespace {

constexpr std::uint8_t class_communications = 0x02;
constexpr std::uint8_t subclass_acm = 0x02;
constexpr std::uint8_t class_data = 0x0a;
constexpr std::uint8_t set_line_coding = 0x20;
constexpr std::uint8_t set_control_line_state = 0x22;
constexpr std::uint16_t dtr_and_rts = 0x0003;
constexpr unsigned control_timeout_ms = 1000;
constexpr std::chrono::seconds arrival_patience{3};
constexpr std::chrono::seconds settling_patience{1};
constexpr std::chrono::milliseconds cancel_patience{500};

/// ERROR, NO_DEVICE, IO and PIPE all mean that the device is gone, whatever the kernel calls it.
ErrorCode code_of(int usb_error) {
  switch (usb_error) {
    case LIBUSB_ERROR_TIMEOUT:
      return ErrorCode::timed_out;
    case LIBUSB_ERROR_ACCESS:
    case LIBUSB_ERROR_BUSY:
      return ErrorCode::refused;
    case LIBUSB_ERROR_NOT_FOUND:
      return ErrorCode::not_found;
    default:
      return ErrorCode::disconnected;
  }
}

tl::unexpected<Error> usb_fail(const std::string& doing, int usb_error) {
  std::string message = doing + ": " + libusb_strerror(usb_error);
  if (usb_error == LIBUSB_ERROR_ACCESS)
    message += "; install lightrig's udev rules, or add the service's user to the device's group";
  if (usb_error == LIBUSB_ERROR_BUSY) message += "; another program has claimed it";
  return fail(code_of(usb_error), std::move(message));
}

std::string serial_of(libusb_device_handle* handle, std::uint8_t index) {
  std::array<unsigned char, 256> text{};
  const int length = index == 0 ? 0
                                : libusb_get_string_descriptor_ascii(handle, index, text.data(),
                                                                     static_cast<int>(text.size()));
  return length > 0 ? std::string(text.begin(), text.begin() + length) : std::string();
}

}  // namespace

/// The transfer that waits for bytes; libusb fills it in whenever its events are handled.
struct CdcAcm::Inbound {
  libusb_transfer* transfer = libusb_alloc_transfer(0);
  std::vector<unsigned char> buffer;
  bool under_way = false;
  int completed = 0;  ///< libusb's, set in its callback

  Inbound() = default;
  ~Inbound() { libusb_free_transfer(transfer); }
  Inbound(const Inbound&) = delete;
  Inbound& operator=(const Inbound&) = delete;
};

CdcAcm::CdcAcm() = default;

void CdcAcm::CloseContext::operator()(libusb_context* context) const { libusb_exit(context); }

Result<CdcAcm> CdcAcm::open(const UsbEndpoint& endpoint) {
  CdcAcm device;
  device.name_ = fmt::format("USB {:04x}:{:04x}", endpoint.vendor, endpoint.product);
  libusb_context* context = nullptr;
  if (const int error = libusb_init(&context); error != 0) return usb_fail("start libusb", error);
  device.context_.reset(context);
  auto found = device.find(endpoint);
  if (!found && found.error().code == ErrorCode::not_found && device.arrives(endpoint)) {
    // Just arrived, it may not answer yet, or not be ours to open yet.
    const auto end = std::chrono::steady_clock::now() + settling_patience;
    for (found = device.find(endpoint); !found && std::chrono::steady_clock::now() < end;
         found = device.find(endpoint))
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  if (!found) return tl::unexpected(found.error());
  if (auto read = device.read_descriptors(); !read) return tl::unexpected(read.error());
  libusb_set_auto_detach_kernel_driver(device.handle_, 1);
  for (int interface : {device.control_interface_, device.data_interface_}) {
    if (const int error = libusb_claim_interface(device.handle_, interface); error != 0)
      return usb_fail(fmt::format("{}: claim interface {}", device.name_, interface), error);
    if (device.control_interface_ == device.data_interface_) break;
  }
  if (auto set = device.configure_line(endpoint.baud); !set) return tl::unexpected(set.error());
  return device;
}

// True once a device of these numbers is plugged in within the patience for it.
bool CdcAcm::arrives(const UsbEndpoint& endpoint) {
  if (libusb_has_capability(LIBUSB_CAP_HAS_HOTPLUG) == 0) return false;
  int arrived = 0;
  libusb_hotplug_callback_handle callback = 0;
  const auto on_arrival = [](libusb_context*, libusb_device*, libusb_hotplug_event, void* seen) {
    *static_cast<int*>(seen) = 1;
    return 1;  // once is enough
  };
  // Enumerating too: it may have come since the list was read.
  const int error = libusb_hotplug_register_callback(
      context_.get(), LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED, LIBUSB_HOTPLUG_ENUMERATE,
      endpoint.vendor, endpoint.product, LIBUSB_HOTPLUG_MATCH_ANY, on_arrival, &arrived, &callback);
  if (error != LIBUSB_SUCCESS) return false;
  const auto end = std::chrono::steady_clock::now() + arrival_patience;
  while (arrived == 0 && std::chrono::steady_clock::now() < end) {
    timeval step{0, 100000};
    libusb_handle_events_timeout_completed(context_.get(), &step, &arrived);
  }
  if (arrived == 0) libusb_hotplug_deregister_callback(context_.get(), callback);
  return arrived != 0;
}

// A stalled endpoint stays stalled until it is told to go on; the transfer that met it is lost.
void CdcAcm::clear_halt(std::uint8_t endpoint) { (void)libusb_clear_halt(handle_, endpoint); }

Result<void> CdcAcm::find(const UsbEndpoint& endpoint) {
  libusb_device** list = nullptr;
  const ssize_t count = libusb_get_device_list(context_.get(), &list);
  if (count < 0) return usb_fail("list USB devices", static_cast<int>(count));
  int alike = 0;
  int open_error = 0;
  std::string serials;
  for (ssize_t i = 0; i < count; ++i) {
    libusb_device_descriptor descriptor{};
    if (libusb_get_device_descriptor(list[i], &descriptor) != 0) continue;
    if (descriptor.idVendor != endpoint.vendor || descriptor.idProduct != endpoint.product)
      continue;
    libusb_device_handle* handle = nullptr;
    if (const int error = libusb_open(list[i], &handle); error != 0) {
      open_error = error;
      continue;
    }
    const std::string serial = serial_of(handle, descriptor.iSerialNumber);
    serials += (serials.empty() ? "" : ", ") + (serial.empty() ? std::string("(none)") : serial);
    const bool wanted = endpoint.serial.empty() || endpoint.serial == serial;
    if (wanted && ++alike == 1)
      handle_ = handle;
    else
      libusb_close(handle);
  }
  libusb_free_device_list(list, 1);
  if (alike == 1) return {};
  // Of several none is the one: it may be asked for again, and is not to stay open meanwhile.
  if (handle_) libusb_close(std::exchange(handle_, nullptr));
  if (alike > 1)
    return fail(ErrorCode::refused,
                fmt::format("{} is there {} times (serials {}): name one by serial in the rig file",
                            name_, alike, serials));
  if (open_error != 0) return usb_fail("open " + name_, open_error);
  return fail(ErrorCode::not_found,
              serials.empty()
                  ? name_ + " is not there; check cable and power, see `lightrig devices`"
                  : fmt::format("{} has no device of serial \"{}\"; there are: {}", name_,
                                endpoint.serial, serials));
}

Result<void> CdcAcm::read_descriptors() {
  libusb_config_descriptor* config = nullptr;
  const int error = libusb_get_active_config_descriptor(libusb_get_device(handle_), &config);
  if (error != 0) return usb_fail(name_ + ": read the configuration", error);
  for (int i = 0; i < config->bNumInterfaces; ++i) {
    const libusb_interface_descriptor& interface = config->interface[i].altsetting[0];
    if (interface.bInterfaceClass == class_communications &&
        interface.bInterfaceSubClass == subclass_acm && control_interface_ < 0)
      control_interface_ = interface.bInterfaceNumber;
    if (interface.bInterfaceClass != class_data || data_interface_ >= 0) continue;
    for (int e = 0; e < interface.bNumEndpoints; ++e) {
      const libusb_endpoint_descriptor& endpoint = interface.endpoint[e];
      if ((endpoint.bmAttributes & LIBUSB_TRANSFER_TYPE_MASK) != LIBUSB_TRANSFER_TYPE_BULK)
        continue;
      if ((endpoint.bEndpointAddress & LIBUSB_ENDPOINT_IN) != 0) {
        bulk_in_ = endpoint.bEndpointAddress;
        packet_ = endpoint.wMaxPacketSize;
      } else {
        bulk_out_ = endpoint.bEndpointAddress;
      }
    }
    data_interface_ = interface.bInterfaceNumber;
  }
  libusb_free_config_descriptor(config);
  if (control_interface_ < 0 || data_interface_ < 0 || bulk_in_ == 0 || bulk_out_ == 0)
    return fail(ErrorCode::invalid_input,
                name_ +
                    " is no CDC-ACM device (no communications and data interface with bulk "
                    "endpoints): give its tty instead");
  return {};
}

Result<void> CdcAcm::configure_line(int baud) {
  // dwDTERate little-endian, 1 stop bit, no parity, 8 data bits.
  const auto rate = static_cast<std::uint32_t>(baud);
  std::array<unsigned char, 7> coding{static_cast<unsigned char>(rate & 0xff),
                                      static_cast<unsigned char>((rate >> 8) & 0xff),
                                      static_cast<unsigned char>((rate >> 16) & 0xff),
                                      static_cast<unsigned char>(rate >> 24),
                                      0,
                                      0,
                                      8};
  constexpr std::uint8_t to_interface = 0x21;  // class request, to an interface, host to device
  const auto index = static_cast<std::uint16_t>(control_interface_);
  int done =
      libusb_control_transfer(handle_, to_interface, set_line_coding, 0, index, coding.data(),
                              static_cast<std::uint16_t>(coding.size()), control_timeout_ms);
  // A purely virtual port may stall this request: there is no line to configure.
  if (done < 0 && done != LIBUSB_ERROR_PIPE) return usb_fail(name_ + ": set line coding", done);
  done = libusb_control_transfer(handle_, to_interface, set_control_line_state, dtr_and_rts, index,
                                 nullptr, 0, control_timeout_ms);
  if (done < 0 && done != LIBUSB_ERROR_PIPE) return usb_fail(name_ + ": raise DTR", done);
  return {};
}

CdcAcm::CdcAcm(CdcAcm&& other) noexcept { *this = std::move(other); }

CdcAcm& CdcAcm::operator=(CdcAcm&& other) noexcept {
  std::swap(context_, other.context_);
  std::swap(handle_, other.handle_);
  std::swap(inbound_, other.inbound_);
  std::swap(control_interface_, other.control_interface_);
  std::swap(data_interface_, other.data_interface_);
  std::swap(bulk_in_, other.bulk_in_);
  std::swap(bulk_out_, other.bulk_out_);
  std::swap(packet_, other.packet_);
  std::swap(name_, other.name_);
  return *this;
}

// The transfer that waits is taken back, which the device may answer late or, unplugged, at once.
void CdcAcm::call_back() {
  if (!inbound_ || !inbound_->under_way) return;
  libusb_cancel_transfer(inbound_->transfer);
  const auto end = std::chrono::steady_clock::now() + cancel_patience;
  while (inbound_->completed == 0 && std::chrono::steady_clock::now() < end) {
    timeval step{0, 10000};
    libusb_handle_events_timeout_completed(context_.get(), &step, &inbound_->completed);
  }
  // libusb still has it: it may be filled in after we are gone, so it is left to it.
  if (inbound_->completed == 0) (void)inbound_.release();
  if (inbound_) inbound_->under_way = false;
}

void CdcAcm::give_back() {
  if (!handle_) return;
  call_back();
  inbound_.reset();
  if (data_interface_ >= 0) libusb_release_interface(handle_, data_interface_);
  if (control_interface_ >= 0 && control_interface_ != data_interface_)
    libusb_release_interface(handle_, control_interface_);
  libusb_close(handle_);
  handle_ = nullptr;
}

CdcAcm::~CdcAcm() { give_back(); }

Result<void> CdcAcm::ask_for_bytes() {
  if (!inbound_) {
    inbound_ = std::make_unique<Inbound>();
    inbound_->buffer.resize(static_cast<std::size_t>(packet_));
  }
  if (inbound_->under_way) return {};
  const auto on_completion = [](libusb_transfer* transfer) {
    *static_cast<int*>(transfer->user_data) = 1;
  };
  libusb_fill_bulk_transfer(inbound_->transfer, handle_, bulk_in_, inbound_->buffer.data(), packet_,
                            on_completion, &inbound_->completed, 0);
  inbound_->completed = 0;
  if (const int error = libusb_submit_transfer(inbound_->transfer); error != 0)
    return usb_fail(name_ + ": read", error);
  inbound_->under_way = true;
  return {};
}

Result<std::string> CdcAcm::read_some(std::chrono::milliseconds patience) {
  if (auto asked = ask_for_bytes(); !asked) return tl::unexpected(asked.error());
  const auto end = std::chrono::steady_clock::now() + patience;
  while (inbound_->completed == 0) {
    const auto left = std::max(std::chrono::microseconds(0),
                               std::chrono::duration_cast<std::chrono::microseconds>(
                                   end - std::chrono::steady_clock::now()));
    timeval step{left.count() / 1000000, left.count() % 1000000};
    const int error =
        libusb_handle_events_timeout_completed(context_.get(), &step, &inbound_->completed);
    if (error != 0 && error != LIBUSB_ERROR_INTERRUPTED) return usb_fail(name_ + ": read", error);
    if (inbound_->completed == 0 && left.count() == 0) return std::string();
  }
  inbound_->under_way = false;
  switch (inbound_->transfer->status) {
    case LIBUSB_TRANSFER_COMPLETED:
    case LIBUSB_TRANSFER_CANCELLED: {
      const auto begin = inbound_->buffer.begin();
      std::string bytes(begin, begin + inbound_->transfer->actual_length);
      if (auto asked = ask_for_bytes(); !asked && bytes.empty())
        return tl::unexpected(asked.error());
      return bytes;
    }
    case LIBUSB_TRANSFER_STALL:
      clear_halt(bulk_in_);
      return usb_fail(name_ + ": read", LIBUSB_ERROR_PIPE);
    default:
      return usb_fail(name_ + ": read", LIBUSB_ERROR_NO_DEVICE);
  }
}

Result<void> CdcAcm::write_all(std::string_view bytes, std::chrono::milliseconds patience) {
  return write_within(
      bytes, patience, name_,
      [this](std::string_view rest, std::chrono::milliseconds left) -> Result<std::size_t> {
        std::string chunk(rest);
        int sent = 0;
        const int error = libusb_bulk_transfer(
            handle_, bulk_out_, reinterpret_cast<unsigned char*>(chunk.data()),
            static_cast<int>(chunk.size()), &sent, static_cast<unsigned>(left.count()));
        if (error == LIBUSB_ERROR_PIPE) clear_halt(bulk_out_);
        if (error != 0) return usb_fail(name_ + ": write", error);
        return static_cast<std::size_t>(sent);
      });
}

}  // namespace lightrig
