#include "config/controller_profile.h"
#include "tests/paths.h"

#include <gtest/gtest.h>

#include <filesystem>

namespace lightrig {
namespace {

namespace fs = std::filesystem;

ControllerProfile shipped(const std::string& name) {
  const auto read =
      read_profile(fs::path(lightrig::test::source_dir) / "config/controllers" / name);
  EXPECT_EQ(to_text(read.diagnostics), "");
  EXPECT_TRUE(read.value.has_value()) << name;
  return read.value.value_or(ControllerProfile{});
}

TEST(ControllerProfiles, AllShippedOnesAreValidAndSayWhatIsUnverified) {
  int profiles = 0;
  for (const auto& entry :
       fs::directory_iterator(fs::path(lightrig::test::source_dir) / "config/controllers")) {
    if (entry.path().extension() != ".toml") continue;
    const ControllerProfile p = shipped(entry.path().filename().string());
    EXPECT_FALSE(p.source.empty()) << entry.path();
    EXPECT_FALSE(p.unverified.empty()) << entry.path();
    ++profiles;
  }
  EXPECT_GE(profiles, 3);
}

// The registers as the maker's manual prints them.
TEST(ControllerProfiles, WriteAnOrientalMoveAsOneBlockOfSixteen) {
  const ControllerProfile p = shipped("oriental_az.toml");
  EXPECT_TRUE(p.move.block);
  ASSERT_EQ(p.move.writes.size(), 8U);
  EXPECT_EQ(p.move.writes.front().item.address, 0x0058);
  int registers = 0;
  for (const ProfileWrite& w : p.move.writes) registers += w.item.registers();
  EXPECT_EQ(registers, 16);
  EXPECT_EQ(p.move.writes[2].quantity, Quantity::position);
  EXPECT_EQ(p.move.writes[2].item.type, RawType::s32);
  EXPECT_EQ(p.move.writes[2].item.order, WordOrder::high_first);
  EXPECT_EQ(p.move.writes[3].item.unit, RawUnit::counts_per_s);
  EXPECT_EQ(p.move.trigger.style, TriggerStyle::implicit);
  EXPECT_EQ(p.stop.trigger.address, 0x007D);
  EXPECT_EQ(p.stop.trigger.set, 1 << 5);
  EXPECT_EQ(p.moving->mask, 1 << 13);
  EXPECT_EQ(p.moving->value, 1 << 13) << "absent value is the mask";
  EXPECT_EQ(p.serial.parity, 'E');
  EXPECT_EQ(p.alarm_texts.at(0x30), "overload");
  EXPECT_FALSE(p.tcp);
}

TEST(ControllerProfiles, WriteALeadshineMoveAsOneBlockOfEight) {
  const ControllerProfile p = shipped("leadshine_pr.toml");
  int registers = 0;
  for (const ProfileWrite& w : p.move.writes) registers += w.item.registers();
  EXPECT_EQ(registers, 8);
  EXPECT_EQ(p.move.writes.front().item.address, 0x6200);
  EXPECT_EQ(p.move.writes.back().constant, 0x0010);
  EXPECT_EQ(p.move.writes[2].item.unit, RawUnit::rpm);
  EXPECT_EQ(p.move.writes[3].item.unit, RawUnit::ms_per_1000_rpm);
  EXPECT_EQ(p.reset_alarm->trigger.set, 0x1111);
}

TEST(ControllerProfiles, HaveARuleThatNoStandingDoneBitCanFool) {
  for (const char* name : {"generic.toml", "oriental_az.toml", "leadshine_pr.toml"}) {
    const ControllerProfile p = shipped(name);
    EXPECT_TRUE(p.done.must_see_busy) << name;
    EXPECT_TRUE(p.moving.has_value()) << name;
    EXPECT_GT(p.done.minimum_delay.count(), 0) << name;
  }
}

TEST(ControllerProfiles, TakeTheirWordOrderFromTheItemBeforeTheController) {
  const ControllerProfile generic = shipped("generic.toml");
  EXPECT_EQ(generic.position.order, WordOrder::high_first);
  std::string text =
      read_profile(fs::path(lightrig::test::source_dir) / "config/controllers/generic.toml").text;
  const auto at = text.find("[position]\n");
  text.insert(at + 11, "word_order = \"low_first\"\n");
  const auto read = read_profile_text(text, "p.toml");
  ASSERT_TRUE(read.value) << to_text(read.diagnostics);
  EXPECT_EQ(read.value->position.order, WordOrder::low_first);
  EXPECT_EQ(read.value->move.writes[0].item.order, WordOrder::high_first);
}

}  // namespace
}  // namespace lightrig
