// The device: plugged in, unplugged, and the time that passes for it.
#include "sim/usb/usb_device.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>

namespace lightrig::sim {
namespace {

using std::chrono::steady_clock;

constexpr auto beat = std::chrono::milliseconds(2);

std::string hex(const std::vector<std::uint8_t>& bytes) {
  std::string text;
  for (const std::uint8_t byte : bytes) text += fmt::format("{:02x}", byte);
  return text;
}

}  // namespace

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
  fcntl(readiness_, F_SETPIPE_SZ, fifo_page);
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
