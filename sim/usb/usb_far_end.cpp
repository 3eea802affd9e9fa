#include "sim/usb/usb_far_end.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <linux/usbdevice_fs.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <umockdev.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <deque>
#include <filesystem>
#include <mutex>
#include <thread>

#include "sim/usb/usb_descriptors.h"

namespace lightrig::sim {
namespace {

using std::chrono::steady_clock;

constexpr auto beat = std::chrono::milliseconds(2);
constexpr int page = 4096;
constexpr std::uint8_t get_descriptor = 6, set_line_coding = 0x20, get_line_coding = 0x21,
                       set_control_line_state = 0x22;
constexpr std::size_t setup_bytes = 8;
constexpr std::uint32_t capabilities = USBDEVFS_CAP_ZERO_PACKET | USBDEVFS_CAP_BULK_CONTINUATION |
                                       USBDEVFS_CAP_NO_PACKET_SIZE_LIM |
                                       USBDEVFS_CAP_REAP_AFTER_DISCONNECT;

/// A transfer that the program has submitted and not yet taken back.
struct Urb {
  UMockdevIoctlClient* client = nullptr;
  UMockdevIoctlData* urb = nullptr;
  UMockdevIoctlData* buffer = nullptr;
  int type = 0, endpoint = 0, length = 0;  ///< as in usbdevfs_urb
  gulong address = 0;                      ///< where the program keeps it
};

std::string hex(const std::vector<std::uint8_t>& bytes) {
  std::string text;
  for (const std::uint8_t byte : bytes) text += fmt::format("{:02x}", byte);
  return text;
}

}  // namespace

/// Everything behind the device node. The test bed calls from its own thread, `tick` from ours.
class UsbFarEnd::Device {
 public:
  Device(const UsbEndpoint& endpoint, GrblFarEnd far_end) : far_end_(std::move(far_end)) {
    identity_.vendor = endpoint.vendor;
    identity_.product = endpoint.product;
    identity_.serial = endpoint.serial;
  }
  ~Device();
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  Result<void> open();
  std::string folder() const { return folder_; }
  std::string history() const {
    const std::lock_guard lock(mutex_);
    return history_;
  }

 private:
  static gboolean on_ioctl(UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer self);
  static void on_vanished(UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer self);
  void plug_in();
  void unplug();
  void serve(const std::stop_token& stop);
  void tick();
  long obey(UMockdevIoctlClient* client, int& error);
  long submit(UMockdevIoctlClient* client, UMockdevIoctlData* data, int& error);
  long reap(UMockdevIoctlData* data, int& error);
  long discard(gulong address, int& error);
  long claim(unsigned interface, int& error);
  long driver_command(UMockdevIoctlData* data, int& error);
  void control(Urb urb);
  void bulk_out(Urb urb);
  void feed_bulk_in();
  void finish(Urb urb, int status, const std::string* bytes, int length);
  void show_readiness();
  void note(const std::string& what) { history_ += what + "\n"; }
  static void release(const Urb& urb);

  UsbIdentity identity_;
  GrblFarEnd far_end_;
  UMockdevTestbed* bed_ = nullptr;
  UMockdevIoctlBase* handler_ = nullptr;
  std::string folder_, syspath_, node_;
  int number_ = 1;
  int readiness_ = -1;  ///< the FIFO in the node's place: full means that there is nothing to reap

  mutable std::mutex mutex_;  // guards what follows
  std::deque<Urb> waiting_, done_;
  std::array<bool, 2> kernel_driver_{true, true};  ///< holds the interface
  bool plugged_ = false, halted_in_ = false, halted_out_ = false, full_ = false;
  steady_clock::time_point back_at_{}, nak_until_{};
  std::array<std::uint8_t, 7> line_{};
  std::string history_;
  std::jthread thread_;  // last
};

UsbFarEnd::Device::~Device() {
  if (thread_.joinable()) {
    thread_.request_stop();
    thread_.join();
  }
  if (plugged_) unplug();
  for (const std::deque<Urb>* urbs : {&waiting_, &done_})
    for (const Urb& urb : *urbs) release(urb);
  if (bed_) g_object_unref(bed_);
  if (handler_) g_object_unref(handler_);
}

Result<void> UsbFarEnd::Device::open() {
  bed_ = umockdev_testbed_new();
  if (!bed_) return fail(ErrorCode::refused, "make a test bed for an emulated USB device: failed");
  gchar* folder = umockdev_testbed_get_root_dir(bed_);
  folder_ = folder;
  g_free(folder);
  handler_ = umockdev_ioctl_base_new();
  g_signal_connect(handler_, "handle-ioctl", G_CALLBACK(on_ioctl), this);
  g_signal_connect(handler_, "client-vanished", G_CALLBACK(on_vanished), this);
  plug_in();
  if (readiness_ < 0)
    return fail(ErrorCode::refused,
                fmt::format("make the node of an emulated USB device: {}", std::strerror(errno)));
  thread_ = std::jthread([this](const std::stop_token& stop) { serve(stop); });
  return {};
}

// A new device number each time, as the kernel gives it.
void UsbFarEnd::Device::plug_in() {
  ++number_;
  node_ = fmt::format("/dev/bus/usb/001/{:03}", number_);
  const std::string text = fmt::format(
      "P: /devices/pci0000:00/usb1/1-{0}\nN: bus/usb/001/{0:03}\nE: DEVTYPE=usb_device\n"
      "E: DEVNAME={1}\nE: BUSNUM=001\nE: DEVNUM={0:03}\nE: MAJOR=189\nE: MINOR={2}\n"
      "E: SUBSYSTEM=usb\nA: busnum=1\\n\nA: devnum={0}\\n\nA: speed=12\\n\n"
      "A: bConfigurationValue=1\\n\nA: idVendor={3:04x}\\n\nA: idProduct={4:04x}\\n\n"
      "A: serial={5}\\n\nH: descriptors={6}\n\n",
      number_, node_, number_ - 1, identity_.vendor, identity_.product, identity_.serial,
      hex(usb_descriptors(identity_)));
  GError* problem = nullptr;
  if (!umockdev_testbed_add_from_string(bed_, text.c_str(), &problem)) {
    g_clear_error(&problem);
    return;
  }
  syspath_ = fmt::format("/sys/devices/pci0000:00/usb1/1-{}", number_);
  umockdev_testbed_attach_ioctl(bed_, node_.c_str(), handler_, &problem);
  g_clear_error(&problem);
  // A program waits for transfers by polling the node for writing. A plain file is always ready and
  // would keep it spinning; a FIFO of one page is ready when we empty it.
  const std::string path = folder_ + node_;
  std::filesystem::remove(path);
  if (mkfifo(path.c_str(), 0600) != 0) return;
  readiness_ = ::open(path.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);
  fcntl(readiness_, F_SETPIPE_SZ, page);
  {
    const std::lock_guard lock(mutex_);
    plugged_ = true;
    halted_in_ = halted_out_ = false;
    kernel_driver_ = {true, true};
    full_ = false;
    show_readiness();
    note("plugged in");
  }
  umockdev_testbed_uevent(bed_, syspath_.c_str(), "add");
}

// Whatever was under way ends with ESHUTDOWN and may still be taken back; all else is ENODEV.
void UsbFarEnd::Device::unplug() {
  {
    const std::lock_guard lock(mutex_);
    plugged_ = false;
    while (!waiting_.empty()) {
      Urb urb = waiting_.front();
      waiting_.pop_front();
      finish(urb, -ESHUTDOWN, nullptr, 0);
    }
    show_readiness();
    note("unplugged");
  }
  umockdev_testbed_uevent(bed_, syspath_.c_str(), "remove");
  GError* ignored = nullptr;
  umockdev_testbed_detach_ioctl(bed_, node_.c_str(), &ignored);
  g_clear_error(&ignored);
  umockdev_testbed_remove_device(bed_, syspath_.c_str());
  std::error_code error;
  std::filesystem::remove(folder_ + node_, error);
  close(readiness_);
  readiness_ = -1;
}

void UsbFarEnd::Device::release(const Urb& urb) {
  if (urb.buffer) umockdev_ioctl_data_unref(urb.buffer);
  if (urb.urb) umockdev_ioctl_data_unref(urb.urb);
}

// Writable while there is something to reap, or the device is gone.
void UsbFarEnd::Device::show_readiness() {
  if (readiness_ < 0) return;
  const bool ready = !done_.empty() || !plugged_;
  if (ready == !full_) return;
  std::array<char, page> bytes{};
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
    const std::size_t from = urb.type == USBDEVFS_URB_TYPE_CONTROL ? setup_bytes : 0;
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
  const std::string data(setup + setup_bytes, setup + urb.length);
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

void UsbFarEnd::Device::tick() {
  const auto now = steady_clock::now();
  bool leave = false, come = false;
  {
    const std::lock_guard lock(mutex_);
    const auto fault = far_end_.tick();
    if (fault && fault->effect == WireEffect::stall) halted_in_ = true;
    if (fault && fault->effect == WireEffect::nak) nak_until_ = now + fault->duration;
    if (fault && fault->effect == WireEffect::unplug && plugged_) {
      leave = true;
      back_at_ = now + fault->duration;
    }
    come = !leave && !plugged_ && now >= back_at_;
    if (plugged_ && now >= nak_until_) {
      // Writes that were held back, in their order.
      for (auto urb = waiting_.begin(); urb != waiting_.end();) {
        if (urb->endpoint != usb_out_endpoint) {
          ++urb;
          continue;
        }
        const Urb one = *urb;
        urb = waiting_.erase(urb);
        bulk_out(one);
      }
      feed_bulk_in();
    }
  }
  if (leave) unplug();
  if (come) plug_in();
}

void UsbFarEnd::Device::serve(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    tick();
    std::this_thread::sleep_for(beat);
  }
}

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
    if (urb.buffer && urb.length >= static_cast<int>(setup_bytes))
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

UsbFarEnd::UsbFarEnd(std::unique_ptr<Device> device) : device_(std::move(device)) {}
UsbFarEnd::~UsbFarEnd() = default;

Result<std::unique_ptr<UsbFarEnd>> UsbFarEnd::open(const UsbEndpoint& endpoint,
                                                   GrblFarEnd far_end) {
  auto device = std::make_unique<Device>(endpoint, std::move(far_end));
  if (auto opened = device->open(); !opened) return tl::unexpected(opened.error());
  return std::unique_ptr<UsbFarEnd>(new UsbFarEnd(std::move(device)));
}

std::string UsbFarEnd::folder() const { return device_->folder(); }
std::string UsbFarEnd::history() const { return device_->history(); }

}  // namespace lightrig::sim
