// Whole sessions over wires only: `lightrig simulate` at the far end, the service beside it, both
// as a person starts them, meeting over Modbus TCP, Modbus RTU, a GRBL tty and USB, with the camera
// by GigE Vision each time. The service takes the rig for a real one: it is armed by hand, and what
// it found is judged by `compare` against the truth that the simulator wrote.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <numeric>
#include <sstream>
#include <thread>

#include "drivers/devices.h"
#include "tests/drivers/child_process.h"
#include "tests/drivers/own_network.h"
#include "tests/paths.h"
#include "tests/wire/small_wire_rig.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using Json = nlohmann::ordered_json;

const std::string lightrig = std::string(lightrig::test::build_dir) + "/lightrig";
const std::string lightrigd = std::string(lightrig::test::build_dir) + "/lightrigd";

std::string text_of(const fs::path& path) {
  std::stringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

class WireSession : public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    for (const Backend& backend : backends())
      if (!backend.built) GTEST_SKIP() << backend.name << " is left out of this build";
    const std::string obstacle = test::enter_own_network();
    if (!obstacle.empty()) GTEST_SKIP() << obstacle;
    std::string name = (fs::temp_directory_path() / "lightrig-wire-XXXXXX").string();
    folder_ = mkdtemp(name.data());
    rig_ = folder_ / "rig.toml";
    socket_ = folder_ / "control.sock";
    log_ = folder_ / "service.log";
    write_rig(1);
  }
  void write_rig(int seed) const {
    test::SmallWireRig rig(GetParam());
    rig.set("seed", std::to_string(seed));
    rig.sessions_in(folder_ / "sessions");
    if (rig.text().find("\ndevice = ") != std::string::npos)
      rig.set("device", "\"" + (folder_ / "device").string() + "\"");
    std::ofstream(rig_) << rig.text();
  }
  void TearDown() override {
    std::error_code ignored;
    if (!folder_.empty()) fs::remove_all(folder_, ignored);
  }

  std::string run(const std::string& arguments, int& code) const {
    FILE* pipe = popen(fmt::format("LIGHTRIG_SOCKET={} timeout 120 {} {} 2>&1 </dev/null",
                                   socket_.string(), lightrig, arguments)
                           .c_str(),
                       "r");
    std::string out;
    std::array<char, 4096> buffer{};
    for (std::size_t n = 0; (n = std::fread(buffer.data(), 1, buffer.size(), pipe)) > 0;)
      out.append(buffer.data(), n);
    const int status = pclose(pipe);
    code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    return out;
  }
  std::string run(const std::string& arguments) const {
    int code = -1;
    std::string out = run(arguments, code);
    EXPECT_EQ(code, 0) << "lightrig " << arguments << ": " << out;
    return out;
  }
  template <class Good>
  bool wait_until(Good good) const {
    for (int i = 0; i < 600; ++i) {
      if (good()) return true;
      std::this_thread::sleep_for(50ms);
    }
    return false;
  }

  /// A session from arming to its seal; its folder. `environment` is what the simulator asked for.
  fs::path capture(const std::string& how, const std::string& environment = "") {
    test::ChildProcess service(
        {"/bin/sh", "-c",
         fmt::format("exec env {} {} --rig {} {} --socket {} >{} 2>&1", environment, lightrigd,
                     rig_.string(), how, socket_.string(), log_.string())});
    int code = -1;
    EXPECT_TRUE(wait_until([&] { return run("status", code), code == 0; })) << text_of(log_);
    if (how.empty()) run("arm");
    EXPECT_TRUE(wait_until([&] { return run("status").find(" armed") != std::string::npos; }))
        << run("status") << text_of(log_);
    const std::string said = run("start --wait");
    service.signal(SIGTERM);
    EXPECT_TRUE(wait_until([&] { return !service.running(); })) << text_of(log_);
    fs::path newest;
    for (const auto& entry : fs::directory_iterator(folder_ / "sessions"))
      if (entry.is_directory() && newest < entry.path()) newest = entry.path();
    return newest;
  }

  double error_against(const fs::path& session, const std::string& truth) const {
    const Json compared = Json::parse(
        run(fmt::format("compare {} {} --json", session.string(), truth)), nullptr, false);
    EXPECT_TRUE(compared.is_object() && compared.contains("percent_log")) << compared.dump();
    return compared.value("percent_log", 1e9);
  }

  fs::path folder_, rig_, socket_, log_;
};

/// Standard deviation of the error of one such session in memory from seed to seed, as
/// tests/wire_spread measured it over 12 seeds, and of the difference of two.
constexpr double sigma_percent = 0.82;
constexpr double within_noise = std::numbers::sqrt2 * sigma_percent;

TEST_P(WireSession, DISABLED_StraysFromSeedToSeed) {
  const char* asked = std::getenv("LIGHTRIG_SPREAD");
  const int sessions = asked ? std::atoi(asked) : 4;
  std::vector<double> errors;
  for (int seed = 1; seed <= sessions; ++seed) {
    write_rig(seed);
    const fs::path session = capture("--simulate --auto-arm --clock-rate inf");
    const Json result = Json::parse(text_of(session / "result/result.json"), nullptr, false);
    ASSERT_TRUE(result.is_object()) << session;
    errors.push_back(result["error"]["percent_log"].get<double>());
    fs::remove_all(folder_ / "sessions");
  }
  const double mean = std::accumulate(errors.begin(), errors.end(), 0.0) / sessions;
  double squares = 0;
  for (const double error : errors) squares += (error - mean) * (error - mean);
  const double sigma = std::sqrt(squares / std::max(1, sessions - 1));
  std::puts(fmt::format("sessions={} mean_percent={:.3f} sigma_percent={:.3f} least_percent={:.3f} "
                        "most_percent={:.3f}",
                        sessions, mean, sigma, *std::ranges::min_element(errors),
                        *std::ranges::max_element(errors))
                .c_str());
  EXPECT_LT(sigma, 1.5 * sigma_percent);
}

TEST_P(WireSession, GivesTheErrorThatTheSameRigInMemoryGives) {
  const fs::path far_end = folder_ / "far_end.json", record = folder_ / "record.jsonl";
  test::ChildProcess simulator(
      {"/bin/sh", "-c",
       fmt::format("exec {} simulate {} --json --record {} >{} 2>{}", lightrig, rig_.string(),
                   record.string(), far_end.string(), (folder_ / "far_end.err").string())});
  ASSERT_TRUE(wait_until([&] { return text_of(far_end).find('\n') != std::string::npos; }))
      << text_of(folder_ / "far_end.err");
  const std::string told = text_of(far_end);
  const Json hosted = Json::parse(told.substr(0, told.find('\n')), nullptr, false);
  ASSERT_TRUE(hosted.is_object()) << told;
  std::string environment;
  for (const auto& [name, value] : hosted["environment"].items())
    environment += name + "=" + value.get<std::string>() + " ";
  const std::string truth = hosted["truth"].get<std::string>();

  const fs::path over_wires = capture("", environment);
  ASSERT_FALSE(HasFailure());
  simulator.signal(SIGTERM);
  ASSERT_TRUE(wait_until([&] { return !simulator.running(); })) << "it does not end when told";
  const fs::path in_memory = capture("--simulate --auto-arm --clock-rate inf");

  const double wire_error = error_against(over_wires, truth);
  const double memory_error = error_against(in_memory, truth);
  RecordProperty("wire_percent", std::to_string(wire_error));
  RecordProperty("memory_percent", std::to_string(memory_error));
  // The drives' counts round the positions, so the noise is another.
  EXPECT_NEAR(wire_error, memory_error, within_noise);
  // The folder of a session that took its rig for real knows no truth.
  EXPECT_EQ(text_of(over_wires / "result/result.json").find("simulated truth"), std::string::npos);

  // The laboratory's own record: nothing was exposed while it moved.
  std::ifstream lines(record);
  int exposures = 0;
  for (std::string line; std::getline(lines, line); ++exposures)
    EXPECT_EQ(Json::parse(line)["moving"], false) << line;
  EXPECT_GT(exposures, 10);
}

INSTANTIATE_TEST_SUITE_P(Over, WireSession,
                         testing::Values("wire_modbus_tcp.toml", "wire_modbus_rtu.toml",
                                         "wire_grbl.toml", "wire_usb.toml"),
                         [](const auto& rig) {
                           std::string name = rig.param;
                           name.resize(name.find('.'));
                           return name;
                         });

}  // namespace
}  // namespace lightrig
