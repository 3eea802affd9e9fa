#include <fmt/format.h>
#include <gmock/gmock.h>

#include <atomic>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "config/read_rig.h"
#include "daemon/session/compare.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/image_numbers.h"
#include "daemon/session/left_out.h"
#include "daemon/session/manifest.h"
#include "daemon/session/reduction.h"
#include "daemon/session/session.h"
#include "sim/open_devices.h"
#include "sim/sim_clock.h"
#include "tests/paths.h"
#include "tests/session/scratch.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::SizeIs;

void replace(std::string& text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  ASSERT_NE(at, std::string::npos) << from;
  text.replace(at, from.size(), to);
}

// The demo's rig with a quarter of its pixels across and fewer lights.
std::string small_demo_rig(const fs::path& sessions) {
  std::string text = read_file(fs::path(lightrig::test::source_dir) / "config/demo.toml").value();
  replace(text, "width_px = 640", "width_px = 160");
  replace(text, "height_px = 480", "height_px = 120");
  replace(text, "fx_px = 3478", "fx_px = 869.5");
  replace(text, "\"../sessions\"", fmt::format("\"{}\"", sessions.string()));
  replace(text, "controllers/generic.toml",
          std::string(lightrig::test::source_dir) + "/config/controllers/generic.toml");
  replace(text, "count = 1000", "count = 120");
  replace(text, "max_lights = 7", "max_lights = 4");
  // Half the set: what reducing and verifying costs is the basis, and they do it ten times here.
  replace(text, R"(leave_out_families = ["plastic"])",
          R"(leave_out_families = ["plastic", "metal", "retroreflector", "fabric", "wood"])");
  return text;
}

/// One captured and reduced session, shared by the tests: each works on a copy.
class Story : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    shared_ = std::make_unique<Scratch>();
    const fs::path rig_file = shared_->path() / "rig.toml";
    std::ofstream(rig_file) << small_demo_rig(shared_->path());
    const auto rig = read_rig(rig_file);
    ASSERT_TRUE(rig.value) << to_text(rig.diagnostics);
    const auto spec = read_session("", *rig.value);
    ASSERT_TRUE(spec.value);
    auto prepared = prepare(*rig.value, *spec.value);
    ASSERT_TRUE(prepared) << prepared.error().message;
    planned_ = planned_left_out(*prepared);
    const auto folder = create_session(*rig.value, *spec.value, *prepared, "story");
    ASSERT_TRUE(folder) << folder.error().message;
    const auto clock = sim::make_clock(std::numeric_limits<double>::infinity());
    const auto world = sim::make_world(*rig.value, spec.value->object, *clock, 1);
    ASSERT_TRUE(world) << world.error().message;
    auto devices = sim::open_devices(*rig.value, *world);
    ASSERT_TRUE(devices) << devices.error().message;
    SessionControl control;
    const SessionEnd end =
        capture(*folder, *rig.value, *spec.value, *prepared, *devices, *clock, control, {});
    ASSERT_EQ(end.outcome, SessionOutcome::done) << end.reason;
    const auto summary = reduce_session(folder->root, "", 2);
    ASSERT_TRUE(summary) << summary.error().message;
    summary_ = *summary;
    const auto sealed = seal_session(*folder);
    ASSERT_TRUE(sealed) << sealed.error().message;
  }
  static void TearDownTestSuite() { shared_.reset(); }

  void SetUp() override {
    ASSERT_TRUE(summary_) << "the session could not be made";
    fs::copy(shared_->path() / "story", session_, fs::copy_options::recursive);
  }

  static std::unique_ptr<Scratch> shared_;
  static std::optional<ReductionSummary> summary_;
  static std::vector<LeftOutLine> planned_;
  Scratch scratch_;
  const fs::path session_ = scratch_.path() / "story";
};

std::unique_ptr<Scratch> Story::shared_;
std::optional<ReductionSummary> Story::summary_;
std::vector<LeftOutLine> Story::planned_;

TEST_F(Story, AMaterialTheBasisNeverSawComesBack) {
  ASSERT_TRUE(summary_->has_truth);
  ASSERT_THAT(summary_->curve, SizeIs(4));
  EXPECT_LT(summary_->true_error.percent_log, 10);
  EXPECT_LT(summary_->true_error.percent_log, summary_->mean_only_error_percent / 3);
  EXPECT_LT(summary_->true_error.percent_log, *summary_->random_lights_error_percent);
  for (std::size_t i = 1; i < summary_->curve.size(); ++i) {
    EXPECT_GT(summary_->curve[i].elapsed_s, summary_->curve[i - 1].elapsed_s);
  }
  const CurvePoint& last = summary_->curve.back();
  ASSERT_TRUE(last.held_out_error_percent);
  EXPECT_LT(*last.held_out_error_percent, 4 * summary_->true_error.percent_log);
  EXPECT_GT(*last.held_out_error_percent, summary_->true_error.percent_log / 4);
}

TEST_F(Story, ResultJsonAgreesWithTheFilesBesideIt) {
  const auto json = nlohmann::json::parse(read_file(session_ / "result/result.json").value());
  const auto brdf = load_brdf(session_);
  ASSERT_TRUE(brdf);
  EXPECT_EQ(json["curve"].size(), 4);
  EXPECT_EQ(json["method"]["basis"]["source"],
            "built-in set, without plastic, metal, retroreflector, fabric, wood");
  EXPECT_EQ(json["curve"].back()["true_error_percent"], json["error"]["percent_log"]);
  EXPECT_EQ(json["lights"].size(), 5);
  EXPECT_GT(json["left_out"]["repeated_bins"]["left_out"], 1000);
  EXPECT_EQ(json["baselines"]["random_lights"]["sets"], 5);
  const auto uncertainty = read_image_numbers(session_ / "result/uncertainty.exr");
  ASSERT_TRUE(uncertainty);
  EXPECT_EQ(uncertainty->width, 90);
  EXPECT_EQ(uncertainty->height, 90);
  const auto radiance = read_image_numbers(session_ / "radiance/L01.exr");
  ASSERT_TRUE(radiance);
  EXPECT_EQ(radiance->width, 160);
  EXPECT_THAT(radiance->channels, testing::ElementsAre("L", "site", "variance"));
  for (const char* picture : {"sphere", "table", "table-difference", "uncertainty", "coverage",
                              "L01", "L01-cells", "H01", "H01-cells"}) {
    EXPECT_TRUE(fs::exists(session_ / "result" / fmt::format("{}.png", picture))) << picture;
  }
}

TEST_F(Story, TheResultSaysTheSameOfWhatWasLeftOutAsThePlan) {
  const auto json = nlohmann::json::parse(read_file(session_ / "result/result.json").value());
  ASSERT_GT(planned_.size(), 10U);
  for (const LeftOutLine& line : planned_) {
    const auto& told = json["left_out"][line.name];
    EXPECT_EQ(told["left_out"], line.left_out) << line.name;
    EXPECT_EQ(told["of"], line.of.value()) << line.name;
    EXPECT_LE(line.left_out, line.of.value()) << line.name;
    EXPECT_EQ(told["left_out"].get<int>() + told["done"].get<int>(), told["of"]) << line.name;
  }
  EXPECT_EQ(json["left_out"]["candidates_unreachable"]["of"], 120) << "candidates of the rig file";
}

TEST_F(Story, IsFoundSoundUnderAnotherName) {
  const fs::path moved = session_.parent_path() / "renamed";
  fs::rename(session_, moved);
  const auto report = verify_session(moved, 1);  // reduced with two threads
  ASSERT_TRUE(report) << report.error().message;
  EXPECT_THAT(report->findings, SizeIs(0));
  EXPECT_TRUE(report->sound);
  EXPECT_THAT(report->summary, HasSubstr("reproduced"));
  EXPECT_THAT(report->summary, HasSubstr("renamed: sound: done"));
}

TEST_F(Story, KeepsItsSealWhenReducedAgain) {
  ASSERT_TRUE(reduce_session(session_, "", 2));
  const auto report = verify_session(session_, 2);
  ASSERT_TRUE(report);
  EXPECT_THAT(report->findings, SizeIs(0));
}

// What a watchdog feeds on: no stage of a reduction is long without a word.
TEST_F(Story, BeatsWithEveryFrameAndShotOfAReduction) {
  std::atomic<int> beats{0};
  std::vector<int> lights, at;
  const auto reduced =
      reduce_session(session_, "", 2, {}, {{}, [&] { ++beats; }}, [&](const CurvePoint& point) {
        lights.push_back(point.lights);
        at.push_back(beats);
      });
  ASSERT_TRUE(reduced) << reduced.error().message;
  EXPECT_EQ(lights, (std::vector<int>{1, 2, 3, 4}));
  for (std::size_t i = 1; i < at.size(); ++i)
    EXPECT_GE(at[i] - at[i - 1], 5) << "frames read, merged, extracted, fitted";
  EXPECT_GE(at.front(), 6) << "the stages of a plan came first";
  EXPECT_GE(beats - at.back(), 10) << "random lights and pictures come after";
}

TEST_F(Story, KeepsItsResultWhereAReductionIsToldToStop) {
  const std::string before = read_file(session_ / "result" / "result.json").value();
  std::stop_source stop;
  stop.request_stop();
  const auto reduced = reduce_session(session_, "", 1, {}, {stop.get_token()});
  ASSERT_FALSE(reduced);
  EXPECT_EQ(reduced.error().code, ErrorCode::stopped);
  EXPECT_EQ(read_file(session_ / "result" / "result.json").value(), before);
  EXPECT_TRUE(verify_session(session_, 1)->sound);
}

TEST_F(Story, IsNotReducedWithAnotherRigFile) {
  const std::string text = read_file(session_ / "rig.toml").value();
  ASSERT_TRUE(write_durably(session_ / "rig.toml", text + "# as if measured again\n"));
  const auto reduced = reduce_session(session_, {}, 1);
  ASSERT_FALSE(reduced);
  EXPECT_THAT(reduced.error().message, HasSubstr("rig.toml is not the one"));
}

TEST_F(Story, NamesADamagedFrame) {
  fs::path frame;
  for (const auto& entry : fs::recursive_directory_iterator(session_ / "frames")) {
    if (entry.path().extension() == ".exr") frame = entry.path();
  }
  std::fstream file(frame, std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(static_cast<std::streamoff>(fs::file_size(frame) / 2));
  file.put('\x5a').put('\x5a').put('\x5a');
  file.close();
  const auto report = verify_session(session_, 1);
  ASSERT_TRUE(report);
  EXPECT_FALSE(report->sound);
  EXPECT_THAT(report->findings,
              testing::Contains(HasSubstr(frame.lexically_relative(session_).string())));
}

TEST_F(Story, NamesAResultThatTheFramesDoNotGive) {
  fs::remove(session_ / "manifest-sha256.txt");  // as if someone had re-made it
  std::string bytes = read_file(session_ / "result/brdf.binary").value();
  char& high = bytes[12 + 8 * 12150 + 6];  // of the mantissa of green's middle cell
  high = static_cast<char>(high ^ 0x04);
  std::ofstream(session_ / "result/brdf.binary", std::ios::binary) << bytes;
  std::string json = read_file(session_ / "result/result.json").value();
  replace(json, "\"components\": ", "\"components\": 1");
  std::ofstream(session_ / "result/result.json") << json;
  const auto report = verify_session(session_, 1);
  ASSERT_TRUE(report);
  EXPECT_FALSE(report->sound);
  EXPECT_THAT(report->findings,
              testing::Contains(HasSubstr("result/brdf.binary: differs in 1 of")));
  EXPECT_THAT(report->findings,
              testing::Contains(HasSubstr("result/result.json: differs at method.components")));
}

TEST_F(Story, NamesAFileThatIsMissingAndOneThatWasPutThereAfterTheSeal) {
  fs::remove(session_ / "radiance/L02.exr");
  std::ofstream(session_ / "frames/L01/more.exr") << "not a frame of this session";
  const auto report = verify_session(session_, 2);
  ASSERT_TRUE(report);
  EXPECT_FALSE(report->sound);
  EXPECT_THAT(report->findings, testing::UnorderedElementsAre(
                                    HasSubstr("radiance/L02.exr"),
                                    HasSubstr("frames/L01/more.exr: is not in the manifest")));
  EXPECT_THAT(report->summary, HasSubstr("story: 2 findings: "));
}

TEST_F(Story, IsComparedAndExported) {
  const fs::path merl = scratch_.path() / "full.binary";
  const auto exported = export_merl(session_, merl);
  ASSERT_TRUE(exported) << exported.error().message;
  EXPECT_EQ(fs::file_size(merl), 34992012);  // 12 + 3 · 90 · 90 · 180 · 8
  const auto a = load_brdf(merl), b = load_brdf(session_);
  ASSERT_TRUE(a && b);
  const auto same = compare(*a, *b, 1e-4, 2);
  ASSERT_TRUE(same) << same.error().message;
  EXPECT_LT(same->error.percent_log, 1e-9);
  EXPECT_NEAR(same->mean_ratio, 1, 1e-9);

  BrdfTable brighter = *b;
  brighter.f *= 1.1;
  const auto scaled = compare(brighter, *b, 1e-4, 2);
  ASSERT_TRUE(scaled);
  EXPECT_NEAR(scaled->mean_ratio, 1.1, 1e-3);  // cells at the floor do not scale
  EXPECT_GT(scaled->error.percent_log, 10 * scaled->percent_log_scaled);
  EXPECT_FALSE(scaled->png.empty());
}

TEST_F(Story, WithoutAResultSaysHowToGetOne) {
  fs::remove_all(session_ / "result");
  const auto brdf = load_brdf(session_);
  ASSERT_FALSE(brdf);
  EXPECT_THAT(brdf.error().message, HasSubstr("lightrig reduce"));
}

TEST(Verify, RefusesAFolderThatIsNoSession) {
  const Scratch scratch;
  const auto report = verify_session(scratch.path(), 1);
  ASSERT_FALSE(report);
  EXPECT_EQ(report.error().code, ErrorCode::not_found);
}

TEST(Manifest, RefusesAPathThatLeadsOut) {
  const Scratch scratch;
  std::ofstream(scratch.path() / "manifest-sha256.txt")
      << std::string(64, 'a') << "  frames/x.exr\n"
      << std::string(64, 'b') << "  ../../etc/passwd\n";
  const auto manifest = read_manifest({scratch.path()});
  ASSERT_FALSE(manifest);
  EXPECT_THAT(manifest.error().message, HasSubstr("manifest-sha256.txt:2"));
}

}  // namespace
}  // namespace lightrig
