// What the disk is promised: files whole or not at all, frames lossless and equal in bytes, a
// journal that can be cut anywhere.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <thread>

#include "daemon/session/durable_file.h"
#include "daemon/session/frame_file.h"
#include "daemon/session/journal.h"
#include "tests/session/scratch.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

Frame some_frame(int width, int height) {
  Frame frame;
  frame.counts.width = width;
  frame.counts.height = height;
  frame.exposure = 0.1 + 1.0 / 3.0;
  std::uint32_t state = 12345;
  for (int i = 0; i < width * height; ++i) {
    state = state * 1664525U + 1013904223U;
    frame.counts.counts.push_back(static_cast<std::uint16_t>(state >> 16U));
  }
  frame.counts.counts.front() = 0;
  frame.counts.counts.back() = 65535;
  return frame;
}

SensorModel sensor_with(ColorFilter filter) {
  SensorModel sensor;
  sensor.filter = filter;
  return sensor;
}

TEST(DurableFile, AppearsWholeAndLeavesNoPartBehind) {
  const Scratch scratch;
  const fs::path path = scratch.path() / "a.txt";
  ASSERT_TRUE(write_durably(path, std::string("first")));
  ASSERT_TRUE(write_durably(path, std::string("second, and longer")));
  EXPECT_EQ(read_file(path).value(), "second, and longer");
  EXPECT_FALSE(fs::exists(scratch.path() / "a.txt.part"));
}

TEST(DurableFile, AMissingFileIsNotFoundAndAFolderThatIsAFileIsRefused) {
  const Scratch scratch;
  EXPECT_EQ(read_file(scratch.path() / "none").error().code, ErrorCode::not_found);
  ASSERT_TRUE(write_durably(scratch.path() / "file", std::string("x")));
  const auto written = write_durably(scratch.path() / "file" / "b", std::string("x"));
  ASSERT_FALSE(written);
  EXPECT_EQ(written.error().code, ErrorCode::refused);
  EXPECT_THAT(written.error().message, HasSubstr("file/b"));
}

// Found as memory filling up: /dev/zero named as a plan, or linked to as session.json.
TEST(DurableFile, OnlyARegularFileIsRead) {
  const Scratch scratch;
  fs::create_symlink("/dev/zero", scratch.path() / "link");
  ASSERT_EQ(::mkfifo((scratch.path() / "fifo").c_str(), 0600), 0);
  for (const fs::path& path :
       {fs::path("/dev/zero"), scratch.path() / "link", scratch.path() / "fifo", scratch.path()}) {
    const auto text = read_file(path);
    ASSERT_FALSE(text) << path;
    EXPECT_EQ(text.error().code, ErrorCode::invalid_input) << path;
    EXPECT_THAT(text.error().message, HasSubstr(path.string()));
  }
  // Files of the kernel say that they are empty, and are not.
  EXPECT_THAT(read_file("/proc/self/status").value_or(""), HasSubstr("Name:"));
}

// FIPS 180-2, appendix B.1, and the digest of nothing.
TEST(DurableFile, Sha256IsTheStandards) {
  EXPECT_EQ(sha256_hex(std::string("abc")),
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256_hex(std::string()),
            "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
}

TEST(DurableFile, AFullDiskSaysNoSpaceAndKeepsTheOldFile) {
  const SmallDisk disk(256 * 1024);
  if (!disk.mounted()) GTEST_SKIP() << "mounting a small tmpfs needs root";
  const fs::path path = disk.path() / "frame.exr";
  ASSERT_TRUE(write_durably(path, std::string("old")));
  const auto written = write_durably(path, std::string(1 << 20, 'x'));
  ASSERT_FALSE(written);
  EXPECT_EQ(written.error().code, ErrorCode::no_space);
  EXPECT_EQ(read_file(path).value(), "old");
  EXPECT_FALSE(fs::exists(disk.path() / "frame.exr.part"));
}

TEST(FrameFile, KeepsEveryCountAndTheExposureToTheLastBit) {
  const Scratch scratch;
  const Frame frame = some_frame(37, 21);
  const auto bytes = encode_frame(frame, sensor_with(ColorFilter::bayer_grbg));
  ASSERT_TRUE(bytes) << bytes.error().message;
  ASSERT_TRUE(write_durably(scratch.path() / "f.exr", *bytes));
  const auto back = read_frame(scratch.path() / "f.exr");
  ASSERT_TRUE(back) << back.error().message;
  EXPECT_EQ(back->counts.width, 37);
  EXPECT_EQ(back->counts.height, 21);
  EXPECT_EQ(back->counts.counts, frame.counts.counts);
  EXPECT_EQ(back->exposure, frame.exposure);
}

TEST(FrameFile, EqualFramesAreEqualBytesAtAnyTimeAndWhateverTheirId) {
  Frame frame = some_frame(64, 48);
  const auto first = encode_frame(frame, sensor_with(ColorFilter::mono));
  const auto png = encode_png(2, 1, 3, {1, 2, 3, 4, 5, 6});
  std::this_thread::sleep_for(std::chrono::milliseconds(1100));  // a time stamp would have moved on
  frame.id = 99;
  ASSERT_TRUE(first);
  EXPECT_EQ(*first, encode_frame(frame, sensor_with(ColorFilter::mono)).value());
  ASSERT_TRUE(png) << png.error().message;
  EXPECT_EQ(*png, encode_png(2, 1, 3, {1, 2, 3, 4, 5, 6}).value());
}

TEST(FrameFile, ATruncatedOrForeignFileIsRefusedWithItsName) {
  const Scratch scratch;
  const auto bytes = encode_frame(some_frame(64, 48), sensor_with(ColorFilter::mono));
  ASSERT_TRUE(bytes);
  for (const std::size_t keep : {std::size_t{0}, std::size_t{100}, bytes->size() - 1}) {
    ASSERT_TRUE(write_durably(scratch.path() / "cut.exr", std::span(*bytes).first(keep)));
    const auto back = read_frame(scratch.path() / "cut.exr");
    ASSERT_FALSE(back) << keep;
    EXPECT_EQ(back.error().code, ErrorCode::invalid_input);
    EXPECT_THAT(back.error().message, HasSubstr("cut.exr"));
  }
  const auto foreign = encode_float_exr(2, 1, {"R", "G", "B"}, {1, 2, 3, 4, 5, 6});
  ASSERT_TRUE(foreign) << foreign.error().message;
  ASSERT_TRUE(write_durably(scratch.path() / "foreign.exr", *foreign));
  EXPECT_EQ(read_frame(scratch.path() / "foreign.exr").error().code, ErrorCode::invalid_input);
  EXPECT_EQ(read_frame(scratch.path() / "none.exr").error().code, ErrorCode::not_found);
}

class JournalTest : public testing::Test {
 protected:
  fs::path path() const { return scratch_.path() / "journal.jsonl"; }
  void write(int events) {
    auto journal = Journal::open(path());
    ASSERT_TRUE(journal) << journal.error().message;
    for (int i = 0; i < events; ++i) {
      ASSERT_TRUE(journal->append("shot", {{"name", "L0" + std::to_string(i)}, {"note", "ü\n\""}}));
    }
  }
  Scratch scratch_;
};

// The checksum was computed by zlib's crc32 over
// {"seq":1,"event":"shot","name":"L00","note":"ü\n\""}.
TEST_F(JournalTest, ALineCarriesTheChecksumOfItselfWithoutIt) {
  write(1);
  EXPECT_EQ(read_file(path()).value(),
            "{\"seq\":1,\"event\":\"shot\",\"name\":\"L00\",\"note\":\"ü\\n\\\"\",\"crc\":"
            "\"bf52257e\"}\n");
}

TEST_F(JournalTest, GoesOnWhereItEndedAndGivesBackWhatItWasTold) {
  write(2);
  write(1);
  const auto replay = replay_journal(path());
  ASSERT_TRUE(replay) << replay.error().message;
  ASSERT_EQ(replay->events.size(), 3U);
  EXPECT_EQ(replay->events[2].sequence, 3U);
  EXPECT_EQ(replay->events[1].event, "shot");
  EXPECT_EQ(replay->events[1].fields.at("note"), "ü\n\"");
  EXPECT_FALSE(replay->torn_tail);
}

TEST_F(JournalTest, CutAtAnyByteLosesOnlyTheLineThatWasCut) {
  write(3);
  const std::string whole = read_file(path()).value();
  for (std::size_t keep = 0; keep <= whole.size(); ++keep) {
    const std::string cut = whole.substr(0, keep);
    ASSERT_TRUE(write_durably(path(), cut));
    auto journal = Journal::open(path());
    ASSERT_TRUE(journal) << "cut at " << keep << ": " << journal.error().message;
    const auto lines = static_cast<std::size_t>(std::count(cut.begin(), cut.end(), '\n'));
    EXPECT_EQ(journal->replayed().size(), lines) << keep;
    EXPECT_EQ(journal->torn_tail(), !cut.empty() && cut.back() != '\n') << keep;
    ASSERT_TRUE(journal->append("resumed", {}));
    EXPECT_EQ(replay_journal(path()).value().events.size(), lines + 1) << keep;
  }
}

TEST_F(JournalTest, DamageAnywhereElseIsRefusedWithItsLineAndNothingIsChanged) {
  write(3);
  const std::string whole = read_file(path()).value();
  for (std::size_t at = 0; at < whole.size(); ++at) {
    std::string damaged = whole;
    damaged[at] = static_cast<char>(damaged[at] ^ 1);
    ASSERT_TRUE(write_durably(path(), damaged));
    const auto journal = Journal::open(path());
    if (at == whole.size() - 1) continue;  // the last newline: that is a torn tail
    ASSERT_FALSE(journal) << "byte " << at;
    EXPECT_EQ(journal.error().code, ErrorCode::invalid_input);
    EXPECT_THAT(journal.error().message, HasSubstr("line "));
    EXPECT_EQ(read_file(path()).value(), damaged);
  }
}

TEST_F(JournalTest, ALostLineIsDamage) {
  write(3);
  const std::string whole = read_file(path()).value();
  const std::size_t second = whole.find('\n') + 1;
  const std::size_t third = whole.find('\n', second) + 1;
  ASSERT_TRUE(write_durably(path(), whole.substr(0, second) + whole.substr(third)));
  EXPECT_THAT(Journal::open(path()).error().message, HasSubstr("line 2 has sequence number 3"));
}

TEST_F(JournalTest, ASecondWriterIsRefused) {
  auto first = Journal::open(path());
  ASSERT_TRUE(first);
  const auto second = Journal::open(path());
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, ErrorCode::refused);
}

TEST(JournalOnAFullDisk, SaysNoSpaceStaysWholeAndGoesOnAfterwards) {
  const SmallDisk disk(64 * 1024);
  if (!disk.mounted()) GTEST_SKIP() << "mounting a small tmpfs needs root";
  auto journal = Journal::open(disk.path() / "journal.jsonl");
  ASSERT_TRUE(journal);
  ASSERT_TRUE(journal->append("opened", {}));
  std::ofstream(disk.path() / "ballast") << std::string(1 << 20, 'x');
  auto full = journal->append("shot", {{"note", std::string(8192, 'x')}});
  ASSERT_FALSE(full);
  EXPECT_EQ(full.error().code, ErrorCode::no_space);
  EXPECT_EQ(replay_journal(disk.path() / "journal.jsonl").value().events.size(), 1U);
  fs::remove(disk.path() / "ballast");
  ASSERT_TRUE(journal->append("shot", {{"note", std::string(8192, 'x')}}));
  const auto replay = replay_journal(disk.path() / "journal.jsonl");
  ASSERT_TRUE(replay) << replay.error().message;
  EXPECT_EQ(replay->events.size(), 2U);
}

}  // namespace
}  // namespace lightrig
