#pragma once

#include <gtest/gtest.h>
#include <poll.h>
#include <unistd.h>

#include <array>
#include <functional>
#include <string>
#include <string_view>
#include <thread>
#include <utility>

#include "sim/pty.h"

namespace lightrig::test {

/// Somebody at the far end of a serial line: what comes goes to `hears`, and what that returns goes
/// back; `ticks`, if any, is asked every few milliseconds what to say unasked.
class PtyPeer {
 public:
  using Hears = std::function<std::string(std::string_view)>;
  using Ticks = std::function<std::string()>;

  explicit PtyPeer(Hears hears, Ticks ticks = {})
      : hears_(std::move(hears)), ticks_(std::move(ticks)) {
    const auto opened = pty_.open("");
    EXPECT_TRUE(opened) << opened.error().message;
    path_ = opened.value_or("");
    thread_ = std::jthread([this](const std::stop_token& stop) { serve(stop); });
  }
  ~PtyPeer() {
    thread_.request_stop();
    thread_.join();
  }
  PtyPeer(const PtyPeer&) = delete;
  PtyPeer& operator=(const PtyPeer&) = delete;

  const std::string& path() const { return path_; }

 private:
  void serve(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      pollfd watch{pty_.descriptor(), POLLIN, 0};
      std::array<char, 256> buffer{};
      if (poll(&watch, 1, 3) > 0) {
        const ssize_t got = read(pty_.descriptor(), buffer.data(), buffer.size());
        if (got > 0) say(hears_({buffer.data(), static_cast<std::size_t>(got)}));
      }
      if (ticks_) say(ticks_());
    }
  }
  void say(const std::string& bytes) const {
    if (bytes.empty()) return;
    EXPECT_EQ(write(pty_.descriptor(), bytes.data(), bytes.size()),
              static_cast<ssize_t>(bytes.size()));
  }

  Hears hears_;
  Ticks ticks_;
  sim::Pty pty_;
  std::string path_;
  std::jthread thread_;  // last
};

}  // namespace lightrig::test
