#include "daemon/session/report.h"

#include <gmock/gmock.h>

#include <nlohmann/json.hpp>

#include "daemon/session/chart.h"
#include "daemon/session/exposures_told.h"
#include "daemon/session/report_text.h"
#include "daemon/session/session_story.h"

namespace lightrig {
namespace {

using testing::HasSubstr;
using testing::Not;

std::vector<std::byte> bytes_of(const std::string& text) {
  std::vector<std::byte> bytes;
  for (const char c : text) bytes.push_back(static_cast<std::byte>(c));
  return bytes;
}

struct Example {
  BrdfBasis basis;
  SessionResult result;

  Example() {
    basis.grid = {2, 2};
    basis.stddev = Eigen::VectorXd::Constant(2, 1.5);
    result.basis = &basis;
    result.session = "20260101T000000Z-brass";
    result.sample_id = "brass <3>";
    result.rig = "demo";
    result.criterion = Criterion::condition;
    result.state = "done";
    result.curve = {{1, 20, 12, 8, 18, 13.0, 11.0}, {2, 41.5, 6, 4, 9, std::nullopt, 5.25}};
    result.baselines.mean_only_percent = 48;
    result.baselines.random_lights = RandomLights{9.1, 6.2, 20, 2, 45};
    result.true_error = BrdfError{5.25, 14, 0.05, 8023};
    result.reference = "truth";
    result.reconstruction.predicted_error_percent = 6;
    result.reconstruction.predicted_low_percent = 4;
    result.reconstruction.predicted_high_percent = std::numeric_limits<double>::infinity();
    result.coefficients.c = Eigen::MatrixXd::Constant(2, 1, 0.25);
    result.coefficients.covariance = {Eigen::MatrixXd::Identity(2, 2) * 0.04};
    LightResult light;
    light.shot.name = "L01";
    light.shot.frames = {{"frames/L01/e0.exr", "bracket", 0.004, ""}};
    light.shot.exposures_skipped = {1.5, 2e-5};
    light.condition = std::numeric_limits<double>::infinity();
    result.lights = {light};
    result.left_out = {{"shadow_rays", "shadow rays", 1234567, 89, "convex & whole"}};
    result.cost = {{"merge", 0.25}, {"fit", 0.5}, {"merge", 0.25}};
    result.warnings = {"scale is nominal"};
  }
};

// The vectors of RFC 4648, section 10.
TEST(Base64, IsThatOfTheStandard) {
  EXPECT_EQ(base64(bytes_of("")), "");
  EXPECT_EQ(base64(bytes_of("f")), "Zg==");
  EXPECT_EQ(base64(bytes_of("fo")), "Zm8=");
  EXPECT_EQ(base64(bytes_of("foo")), "Zm9v");
  EXPECT_EQ(base64(bytes_of("foob")), "Zm9vYg==");
  EXPECT_EQ(base64(bytes_of("fooba")), "Zm9vYmE=");
  EXPECT_EQ(base64(bytes_of("foobar")), "Zm9vYmFy");
}

TEST(Report, SpeaksOfTimeAsPeopleDo) {
  EXPECT_EQ(spoken_duration(4.24), "4.2 s");
  EXPECT_EQ(spoken_duration(59), "59 s");
  EXPECT_EQ(spoken_duration(192), "3 min 12 s");
  EXPECT_EQ(spoken_duration(3900), "1 h 05 min");
  EXPECT_EQ(spoken_duration(-1), "–");
}

TEST(Report, NeedsNothingButItself) {
  const Example example;
  ResultPictures pictures;
  pictures.spheres = {"sphere.png", 100, bytes_of("png")};
  const std::string html = report_html(example.result, pictures);
  EXPECT_THAT(html, HasSubstr("src=\"data:image/png;base64,cG5n\""));
  for (const char* outside : {"<script", "<link", "http:", "https:", "url(", "@import"}) {
    EXPECT_THAT(html, Not(HasSubstr(outside)));
  }
}

TEST(Report, StatesWhatItFoundAndWhatItCost) {
  const Example example;
  const std::string html = report_html(example.result, {});
  for (const char* text : {"brass &lt;3&gt;", "5.2 %", "48 %", "9.1 %", "scale is nominal",
                           "1\u202f234\u202f567", "convex &amp; whole",
                           "20 µs: no lit pixel is too bright for a longer one; 1.5 s: the darkest",
                           "∞ (rank still growing)", "<td>merge</td><td class=n>0.500</td>"}) {
    EXPECT_THAT(html, HasSubstr(text));
  }
  EXPECT_THAT(html, Not(HasSubstr("brass <3>")));
}

TEST(Report, SaysThatTheHeldOutLightIsNoEstimateOfTheTrueError) {
  Example example;
  example.result.held_out = HeldOutError{1.5, 0.75, 40};
  EXPECT_THAT(report_html(example.result, {}), HasSubstr("no estimate of the true error"));
  const auto json = nlohmann::json::parse(result_json(example.result));
  EXPECT_THAT(json["held_out"]["measures"].get<std::string>(),
              HasSubstr("not calibrated against the true error"));
}

TEST(Warnings, SayWhereThePseudoInverseHasFewerRowsThanComponents) {
  EXPECT_THAT(rank_loss(Estimator::pseudo_inverse, 26, 45), HasSubstr("26 of the 45 components"));
  EXPECT_EQ(rank_loss(Estimator::pseudo_inverse, 45, 45), "");
  EXPECT_EQ(rank_loss(Estimator::map, 26, 45), "");
}

TEST(Report, HasNoNumberThatIsNone) {
  Example example;
  example.result.curve[0].predicted_high_percent = std::nan("");
  example.result.baselines.mean_only_percent = std::numeric_limits<double>::infinity();
  const std::string html = report_html(example.result, {});
  for (const char* none : {"nan", "inf "}) {
    EXPECT_THAT(html.substr(html.find("</style>")), Not(HasSubstr(none)));
  }
}

TEST(ResultJson, SaysErrorAgainstElapsedTimeAndWhatElseWouldHaveGiven) {
  const Example example;
  const auto json = nlohmann::json::parse(result_json(example.result));
  EXPECT_EQ(json["schema"], "lightrig.result/1");
  EXPECT_EQ(json["curve"][1]["lights"], 2);
  EXPECT_EQ(json["curve"][1]["elapsed_s"], 41.5);
  EXPECT_EQ(json["curve"][1]["true_error_percent"], 5.25);
  EXPECT_TRUE(json["curve"][1]["held_out_error_percent"].is_null());
  EXPECT_EQ(json["baselines"]["mean_only"]["percent"], 48);
  EXPECT_EQ(json["baselines"]["random_lights"]["pseudo_inverse_percent"], 9.1);
  EXPECT_EQ(json["baselines"]["random_lights"]["map_percent"], 6.2);
  EXPECT_EQ(json["error"]["percent_log"], 5.25);
  EXPECT_EQ(json["scale"], "nominal");
  EXPECT_EQ(json["left_out"]["shadow_rays"]["left_out"], 1234567);
  EXPECT_EQ(json["cost"]["seconds"]["merge"], 0.5);
  EXPECT_TRUE(json["lights"][0]["condition"].is_null());
  EXPECT_TRUE(json["predicted_interval_90_percent"][1].is_null());
}

TEST(Report, SaysWhatTheScaleStandsOnAndWhichFilesItWasTakenFrom) {
  Example example;
  EXPECT_THAT(report_html(example.result, {}), HasSubstr("nominal: "));
  example.result.absolute_scale = true;  // written by hand
  EXPECT_THAT(report_html(example.result, {}), HasSubstr("no white reference was taken"));
  auto json = nlohmann::json::parse(result_json(example.result));
  EXPECT_EQ(json["scale"], "absolute");
  EXPECT_THAT(json["scale_by"].get<std::string>(), HasSubstr("no white reference was taken"));
  EXPECT_TRUE(json["white_reference"].is_null());
  EXPECT_TRUE(json["calibration"].is_null());
  example.result.white = {"white.json", "2026-05-04T03:02:01Z", "abc123", 0.0042};
  example.result.lens = {"camera.json", "2026-05-03T03:02:01Z", "def456", 0.25};
  const std::string html = report_html(example.result, {});
  EXPECT_THAT(html, Not(HasSubstr("no white reference was taken")));
  EXPECT_THAT(html, HasSubstr("white.json of 2026-05-04T03:02:01Z, ± 0.42 %, sha256 abc123"));
  EXPECT_THAT(html, HasSubstr("camera.json of 2026-05-03T03:02:01Z, fx ± 0.25 px, sha256 def456"));
  json = nlohmann::json::parse(result_json(example.result));
  EXPECT_EQ(json["scale_by"], "absolute: by a white reference");
  EXPECT_EQ(json["white_reference"]["relative_standard_error"], 0.0042);
  EXPECT_EQ(json["calibration"]["sha256"], "def456");
}

TEST(CoefficientsJson, HoldsTheEstimateAndItsStandardDeviation) {
  const Example example;
  const auto json = nlohmann::json::parse(coefficients_json(example.result));
  EXPECT_EQ(json["c"][0], (std::vector<double>{0.25, 0.25}));
  EXPECT_NEAR(json["stddev"][0][1].get<double>(), 0.2, 1e-15);
  EXPECT_EQ(json["prior_stddev"], (std::vector<double>{1.5, 1.5}));
}

TEST(Chart, LeavesOutWhatCannotStandOnALogAxis) {
  Chart chart;
  chart.lines = {{"a", "a", {{1, 5}, {2, 0}, {3, -1}, {4, std::nan("")}, {5, 2}}}};
  chart.levels = {{"none", "none", 0}};
  const std::string svg = to_svg(chart, 400, 300);
  EXPECT_THAT(svg, Not(HasSubstr("nan")));
  EXPECT_THAT(svg, Not(HasSubstr("none")));
  std::size_t dots = 0;
  for (std::size_t at = svg.find("<circle"); at != std::string::npos;
       at = svg.find("<circle", at + 1)) {
    ++dots;
  }
  EXPECT_EQ(dots, 2);
}

TEST(Chart, KeepsItsNamesApart) {
  Chart chart;
  for (const char* name : {"one", "two", "three", "four"}) {
    chart.lines.push_back({name, "s", {{1, 5}, {2, 5}}});
  }
  const std::string svg = to_svg(chart, 400, 300);
  std::vector<double> heights;
  for (const char* name : {">one<", ">two<", ">three<", ">four<"}) {
    const std::size_t end = svg.find(name);
    ASSERT_NE(end, std::string::npos);
    const std::size_t y = svg.rfind("y=\"", end) + 3;
    heights.push_back(std::stod(svg.substr(y)));
  }
  std::sort(heights.begin(), heights.end());
  for (std::size_t i = 1; i < heights.size(); ++i) EXPECT_GE(heights[i] - heights[i - 1], 15);
}

// Offered 20 µs, 0.32 ms, 5.12 ms, 82 ms, 1.3 s; metered with 5.12 ms, of which 5.12 and 82 ms came
// to be needed. A journal of before called the metering frame's own exposure skipped too.
TEST(ExposuresTold, CountTheMeteringFrameAndSayWhyTheOthersWereNotNeeded) {
  CapturedShot shot;
  shot.frames = {{"ambient.exr", "ambient", 1.3, ""},
                 {"metering.exr", "metering", 5.12e-3, ""},
                 {"e4.exr", "bracket", 82.0001e-3, ""}};
  shot.exposures_skipped = {20e-6, 0.32e-3, 5.12e-3, 1.3};
  const ExposuresTold told = exposures_told(shot);
  EXPECT_THAT(told.used, testing::ElementsAre(5.12e-3, 82.0001e-3));
  ASSERT_EQ(told.skipped.size(), 3U);
  EXPECT_TRUE(told.skipped[0].shorter);
  EXPECT_EQ(told.skipped[1].exposure, 0.32e-3);
  EXPECT_TRUE(told.skipped[1].shorter);
  EXPECT_EQ(told.skipped[2].exposure, 1.3);
  EXPECT_FALSE(told.skipped[2].shorter);
  // None but the shortest was needed: the metering frame is longer than that, and so is the rest.
  shot.frames[2] = {"e1.exr", "bracket", 20e-6, ""};
  shot.exposures_skipped = {0.32e-3, 82e-3, 1.3};
  for (const auto& one : exposures_told(shot).skipped) EXPECT_FALSE(one.shorter);
}

TEST(Report, SaysBesideALightWhyItsExposuresWereSkipped) {
  const Example example;
  const std::string html = report_html(example.result, {});
  EXPECT_THAT(html, HasSubstr("no lit pixel is too bright for a longer one"));
  EXPECT_THAT(html, HasSubstr("the darkest pixel has its signal-to-noise without it"));
}

}  // namespace
}  // namespace lightrig
