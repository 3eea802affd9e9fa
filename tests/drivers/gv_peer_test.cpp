// Independent peers against our simulated camera: Aravis' own conformity test, and its plain
// client.
#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <fstream>
#include <regex>

#include "tests/drivers/gv_camera_rig.h"

namespace lightrig {
namespace {

/// What a program prints, and its exit code.
struct Ran {
  std::string output;
  int code = -1;
};

Ran run(const std::string& command) {
  Ran ran;
  FILE* pipe = popen(("timeout 60 " + command + " 2>&1").c_str(), "r");
  if (!pipe) return ran;
  std::array<char, 4096> buffer{};
  while (fgets(buffer.data(), buffer.size(), pipe)) ran.output += buffer.data();
  ran.code = pclose(pipe);
  return ran;
}

int count(const std::string& text, const std::string& word) {
  int found = 0;
  for (std::size_t at = text.find(word); at != std::string::npos; at = text.find(word, at + 1))
    ++found;
  return found;
}

/// The picture is larger here, so that a frame is many packets.
class GvPeer : public test::GvCameraTest {
 protected:
  void SetUp() override {
    GvCameraTest::SetUp();
    if (IsSkipped() || HasFatalFailure()) return;
    Rig rig = test::gv_rig();
    rig.camera.model.width = 320;
    rig.camera.model.height = 240;
    host(rig);
    configuration_ = testing::TempDir() + "lightrig_arv_test_" + std::to_string(getpid()) + ".cfg";
    std::ofstream(configuration_) << "[lightrig:Simulated]\nSchema=1.0\nSensorSize=320;240\n";
  }
  void TearDown() override { std::remove(configuration_.c_str()); }

  std::string configuration_;
};

TEST_F(GvPeer, AravisConformityTestPassesInEveryLine) {
  // Two of its lines measure frames per second, which a loaded machine may spoil: three attempts.
  Ran ran;
  for (int attempt = 0; attempt < 3 && count(ran.output, "SUCCESS") < 19; ++attempt)
    ran = run("arv-test-0.8 --packet-socket -n '*SIM1*' -c " + configuration_);
  EXPECT_EQ(count(ran.output, "SUCCESS"), 19) << ran.output;
  EXPECT_EQ(count(ran.output, "FAILURE"), 0) << ran.output;
  EXPECT_EQ(count(ran.output, "IGNORED"), 0) << ran.output;
  EXPECT_NE(ran.output.find("Genicam:Schema                      SUCCESS 1.0"), std::string::npos)
      << ran.output;
}

TEST_F(GvPeer, PlainAravisStreamsWithoutAnErrorWhileOnePercentIsLost) {
  faults_->lose(0.01, true, 5);
  const Ran ran =
      run("arv-camera-test-0.8 -n 127.0.0.1 -e 1000 -i 1500 -f 20 -q 2.0 -m 2000 --duration 3");
  std::smatch completed;
  ASSERT_TRUE(
      std::regex_search(ran.output, completed, std::regex("n_completed_buffers *[:=] *([0-9]+)")))
      << ran.output;
  EXPECT_GT(std::stoi(completed[1]), 20) << ran.output;
  std::smatch failed;
  ASSERT_TRUE(std::regex_search(ran.output, failed, std::regex("n_failures *[:=] *([0-9]+)")))
      << ran.output;
  EXPECT_EQ(std::stoi(failed[1]), 0) << ran.output;
  EXPECT_GT(faults_->packets_lost(), 10U);
}

TEST_F(GvPeer, PlainAravisReadsAndWritesItsFeatures) {
  const Ran listed = run("arv-tool-0.8");
  EXPECT_NE(listed.output.find("lightrig-Simulated-SIM1 (127.0.0.1)"), std::string::npos)
      << listed.output;
  const Ran set =
      run("arv-tool-0.8 -a 127.0.0.1 control ExposureTime=12345 PixelFormat=Mono12p Gain=6.5 "
          "ChunkModeActive=true PayloadSize Width");
  for (const char* line : {"ExposureTime = 12345 ", "PixelFormat = Mono12p", "Gain = 6.5 ",
                           "PayloadSize = 115208", "Width = 320"})
    EXPECT_NE(set.output.find(line), std::string::npos) << line << " in:\n" << set.output;
  const Ran beyond = run("arv-tool-0.8 -a 127.0.0.1 control ExposureTime=1e12");
  EXPECT_NE(beyond.output.find("invalid-parameter"), std::string::npos) << beyond.output;
}

}  // namespace
}  // namespace lightrig
