// Faults as text, as docs/simulate.md has them.
#include <gmock/gmock.h>

#include "sim/hosted_rig.h"
#include "tests/drivers/wire_rig.h"

namespace lightrig {
namespace {

TEST(WireFaultScript, SaysWhereItIsWrong) {
  sim::HostedRig hosted;
  RealClock clock;
  hosted.world = test::world_of(test::quick_rig(), clock);
  hosted.faults = std::make_shared<sim::WireFaults>(hosted.world);
  hosted.camera_faults = std::make_shared<sim::CameraWireFaults>();
  const auto wrong = hosted.add_faults("silence request=3\n# nothing\n\nlate mss=4\n", "f.txt");
  ASSERT_FALSE(wrong);
  EXPECT_THAT(wrong.error().message, testing::StartsWith("f.txt:4: error: \"mss=4\""));
  const auto sound = hosted.add_faults(
      "silence request=3 # one\nslip axis=azimuth degrees=-2\npacket_lost frame=7\n"
      "loss share=0.01 resend=no seed=3\n",
      "f");
  EXPECT_TRUE(sound) << sound.error().message;
  for (const char* line :
       {"request=3", "silence request=0", "slip axis=tilt", "packet_lost frame=0", "silnce", "loss",
        "loss share=2", "loss share=0.1 resend=maybe", "stale_frame request=3"})
    EXPECT_FALSE(hosted.add_fault(line)) << line;
  EXPECT_TRUE(hosted.struck().empty());
}

}  // namespace
}  // namespace lightrig
