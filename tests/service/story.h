#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <thread>

#include "daemon/service/host.h"
#include "tests/service/raw_http.h"
#include "tests/service/scratch_folder.h"
#include "tests/service/small_rig.h"

namespace lightrig {

// What a session may take: a second, and under a sanitizer minutes.
inline constexpr std::chrono::seconds patience{280};

/// A service on a socket in a folder of its own.
class ServiceStory : public ::testing::Test {
 protected:
  using Json = nlohmann::ordered_json;
  void SetUp() override { begin(std::numeric_limits<double>::infinity()); }

  void begin(double clock_rate) {
    host_.reset();
    HostSettings settings;
    settings.service.rig = small_rig(folder_.path());
    settings.service.simulate = true;
    settings.service.clock_rate = clock_rate;
    if (!session_root_.empty()) settings.service.rig.session_root = session_root_;
    settings.socket = socket_;
    settings.use_activated_sockets = false;
    auto host = Host::start(std::move(settings), log_);
    ASSERT_TRUE(host) << host.error().message;
    host_ = std::move(*host);
  }

  RawReply get(const std::string& path) { return request(RawConnection(socket_), "GET", path); }
  RawReply post(const std::string& path, const std::string& body = "{}",
                const std::string& headers = mutation_headers) {
    return request(RawConnection(socket_), "POST", path, body, headers);
  }
  Json status() {
    const RawReply reply = get("/v1/status");
    EXPECT_EQ(reply.status, 200) << reply.how;
    return reply.json();
  }

  /// Waits until the status satisfies, and gives it.
  Json wait_for(const std::function<bool(const Json&)>& good,
                std::chrono::seconds within = patience) {
    const auto end = std::chrono::steady_clock::now() + within;
    Json last = status();
    while (!(last.is_object() && good(last)) && std::chrono::steady_clock::now() < end) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
      last = status();
    }
    EXPECT_TRUE(last.is_object() && good(last)) << last.dump(1);
    return last;
  }
  Json wait_for_state(const std::string& state) {
    return wait_for([&](const Json& now) { return now["state"] == state && !now["busy"]; });
  }
  void arm() {
    EXPECT_EQ(post("/v1/arm").status, 202);
    wait_for_state("armed");
  }
  std::string start(const std::string& body = "{}") {
    const RawReply reply = post("/v1/sessions", body);
    EXPECT_EQ(reply.status, 201) << reply.body;
    return reply.status == 201 ? reply.json()["id"].get<std::string>() : "";
  }

  ScratchFolder folder_;
  std::filesystem::path session_root_;  ///< instead of the folder's own
  const std::filesystem::path socket_ = folder_.path() / "control.sock";
  Log log_{LogLevel::warning, Log::Sink::none};
  std::unique_ptr<Host> host_;
};

}  // namespace lightrig
