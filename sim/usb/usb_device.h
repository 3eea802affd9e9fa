#pragma once

#include <umockdev.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <deque>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "sim/usb/usb_descriptors.h"
#include "sim/usb/usb_far_end.h"

namespace lightrig::sim {

constexpr int fifo_page = 4096;             ///< [byte] the least that a FIFO holds
constexpr std::size_t usb_setup_bytes = 8;  ///< before the data of a control transfer

/// A transfer that the program has submitted and not yet taken back.
struct Urb {
  UMockdevIoctlClient* client = nullptr;
  UMockdevIoctlData* urb = nullptr;
  UMockdevIoctlData* buffer = nullptr;
  int type = 0, endpoint = 0, length = 0;  ///< as in usbdevfs_urb
  gulong address = 0;                      ///< where the program keeps it
};

/// Everything behind the device node: the device itself in usb_device.cpp, its transfers in
/// usb_transfers.cpp, what a program asks of the kernel in usbfs_calls.cpp. The test bed calls from
/// its own thread, `tick` from ours.
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
  std::chrono::steady_clock::time_point back_at_{}, nak_until_{};
  std::array<std::uint8_t, 7> line_{};
  std::string history_;
  std::jthread thread_;  // last
};

}  // namespace lightrig::sim
