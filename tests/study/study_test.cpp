#include "study/study.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <map>
#include <random>
#include <sstream>

#include "core/brdf_table.h"
#include "study/report.h"
#include "study/row.h"
#include "study/scene.h"
#include "study/store.h"
#include "tests/paths.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;

std::string text_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

/// A folder of sixteen smooth materials as MERL files on a 24 × 24 grid, and room for studies.
class Study : public testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::path(testing::TempDir()) /
            fmt::format("study-{}", testing::UnitTest::GetInstance()->current_test_info()->name());
    fs::remove_all(root_);
    fs::create_directories(root_ / "materials");
    std::mt19937_64 random(5);
    std::normal_distribution<double> normal;
    for (int m = 0; m < 16; ++m) {
      MerlTable table{24, 24, 1, std::vector<double>(3 * 24 * 24)};
      const double width = std::exp(-2 + 0.7 * normal(random)), height = 3 + normal(random);
      for (int channel = 0; channel < 3; ++channel) {
        const double base = -2 + 0.7 * normal(random);
        for (int i = 0; i < 24 * 24; ++i) {
          const double h = (i / 24 + 0.5) / 24, d = (i % 24 + 0.5) / 24;
          const double lobe = height * std::exp(-h * h / width) + 0.4 * d * d * std::sin(m + d);
          table.f[static_cast<std::size_t>(channel * 576 + i)] = std::exp(base + lobe);
        }
      }
      const std::vector<std::byte> bytes = encode_merl(table);
      std::ofstream out(root_ / "materials" / fmt::format("m{}.binary", 10 + m), std::ios::binary);
      out.write(reinterpret_cast<const char*>(bytes.data()),
                static_cast<std::streamsize>(bytes.size()));
    }
    options_.materials = (root_ / "materials").string();
    options_.splits = 2;
    options_.lights = {1, 3};
    options_.candidates = 60;
    options_.components = 8;
    options_.random_runs = 2;
    options_.out = root_ / "whole";
  }
  void TearDown() override { fs::remove_all(root_); }

  StudySummary run(const StudyOptions& options) {
    Result<StudySummary> summary = run_study(options, nullptr);
    EXPECT_TRUE(summary.has_value()) << (summary ? "" : summary.error().message);
    return summary ? *summary : StudySummary{};
  }

  fs::path root_;
  StudyOptions options_;
};

TEST_F(Study, WritesEveryRowAndAReportThatStandsAlone) {
  int calls = 0;
  const Result<StudySummary> summary =
      run_study(options_, [&](const StudyProgress& p) { calls = p.jobs_done; });
  ASSERT_TRUE(summary.has_value()) << summary.error().message;
  EXPECT_TRUE(summary->complete);
  EXPECT_EQ(calls, 2);
  std::istringstream csv(text_of(options_.out / "study.csv"));
  std::string line;
  std::getline(csv, line);
  EXPECT_EQ(line + "\n", study_header());
  int rows = 0;
  while (std::getline(csv, line)) {
    const std::optional<StudyRow> row = study_row_from_csv(line);
    ASSERT_TRUE(row.has_value()) << line;
    EXPECT_TRUE(std::isfinite(row->percent_log)) << line;
    EXPECT_EQ(to_csv(*row), line + "\n");
    ++rows;
  }
  // 3 test materials × 2 splits × (mean, all samples + (4 planned + 2 runs × 2 random methods) × 2
  // counts); these materials do not depend on φd, so that there is no bivariate approximation.
  EXPECT_EQ(rows, 3 * 2 * (2 + (4 + 4) * 2));
  const std::string html = text_of(options_.out / "report.html");
  EXPECT_THAT(html, testing::HasSubstr("<svg"));
  EXPECT_THAT(html, testing::Not(testing::HasSubstr("http://")));
  EXPECT_THAT(html, testing::Not(testing::HasSubstr("<script")));
}

TEST_F(Study, OfMergedShardsEqualsTheWholeByteForByte) {
  run(options_);
  StudyOptions shard = options_;
  shard.shard_count = 2;
  std::vector<fs::path> folders;
  for (shard.shard_index = 0; shard.shard_index < 2; ++shard.shard_index) {
    shard.out = root_ / fmt::format("shard{}", shard.shard_index);
    EXPECT_FALSE(run(shard).complete);
    folders.push_back(shard.out);
  }
  const Result<StudySummary> merged = merge_study(folders, root_ / "merged");
  ASSERT_TRUE(merged.has_value()) << merged.error().message;
  EXPECT_TRUE(merged->complete);
  EXPECT_EQ(text_of(root_ / "merged" / "study.csv"), text_of(options_.out / "study.csv"));
  EXPECT_EQ(text_of(root_ / "merged" / "splits.csv"), text_of(options_.out / "splits.csv"));
}

TEST_F(Study, OfAxesIsTheirProductAndTheUsualSettingsGiveTheNamedMethods) {
  options_.lights = {3};
  options_.criteria = {"condition", "a-optimal"};
  options_.estimators = {"map"};
  options_.component_counts = {3, 8};
  options_.methods = {"pixels-map"};
  const StudySummary summary = run(options_);
  std::map<std::string, std::vector<double>> errors;
  std::istringstream csv(text_of(options_.out / "study.csv"));
  std::string line;
  std::getline(csv, line);
  while (std::getline(csv, line)) {
    const StudyRow row = *study_row_from_csv(line);
    errors[row.method].push_back(row.percent_log);
  }
  ASSERT_EQ(errors.size(), 5U);
  EXPECT_EQ(errors.at("a-optimal:pixels:map:k=3").size(), 6U);
  // Three components cannot say what eight can.
  double few = 0, many = 0;
  for (const double e : errors.at("condition:pixels:map:k=3")) few += e;
  for (const double e : errors.at("condition:pixels:map:k=8")) many += e;
  EXPECT_GT(few, many);
}

TEST_F(Study, RefusesAMethodThatItDoesNotKnowAndSaysWhichThereAre) {
  options_.methods = {"a-optimal:voxels:map"};
  const auto refused = run_study(options_, nullptr);
  ASSERT_FALSE(refused.has_value());
  EXPECT_THAT(refused.error().message, testing::HasSubstr("\"voxels\" is no kind of point"));
  EXPECT_THAT(refused.error().message, testing::HasSubstr("paper-map"));
}

TEST_F(Study, PredictsTheMinutesOfAGivenRigAndTheyGrowWithTheLights) {
  options_.methods = {"paper-map"};
  options_.rig = lightrig::test::source_dir + std::string("/config/demo.toml");
  run(options_);
  std::map<int, double> seconds;
  std::istringstream csv(text_of(options_.out / "study.csv"));
  std::string line;
  std::getline(csv, line);
  while (std::getline(csv, line)) {
    const StudyRow row = *study_row_from_csv(line);
    seconds[row.lights] = row.capture_s;
  }
  EXPECT_GT(seconds.at(1), 0);
  EXPECT_GT(seconds.at(3), seconds.at(1));
  const std::string html = text_of(options_.out / "report.html");
  EXPECT_THAT(html, testing::HasSubstr("motion model of rig"));
}

TEST_F(Study, RemarksOfTheRigAndOfTheMaterialsAreBothSaid) {
  options_.methods = {"mean"};
  options_.rig = lightrig::test::source_dir + std::string("/config/demo.toml");
  std::ofstream(root_ / "materials" / "torn.binary") << "no material";
  EXPECT_THAT(run(options_).remarks,
              testing::UnorderedElementsAre(testing::HasSubstr("capture times are of rig"),
                                            testing::HasSubstr("torn: left out")));
}

TEST_F(Study, RecordsWhatEverySplitLearntByLeavingMaterialsOut) {
  options_.methods = {"a-optimal-map", "a-optimal:pixels:map-stacked"};
  run(options_);
  std::istringstream csv(text_of(options_.out / "splits.csv"));
  std::string line;
  std::getline(csv, line);
  EXPECT_EQ(line + "\n", split_header());
  int lines = 0;
  while (std::getline(csv, line)) {
    std::vector<std::string> field;
    std::istringstream fields(line);
    for (std::string one; std::getline(fields, one, ',');) field.push_back(one);
    ASSERT_EQ(field.size(), 7U) << line;
    EXPECT_EQ(field[0], std::to_string(lines / 3));
    EXPECT_EQ(field[2], "13") << "of sixteen materials";
    EXPECT_EQ(field[4].empty(), field[1] == "pseudo-inverse") << "which knows no deviation";
    EXPECT_GT(field[4].empty() ? 1 : std::stod(field[4]), 0);
    EXPECT_GT(std::stod(field[6]), 0);
    ++lines;
  }
  EXPECT_EQ(lines, 2 * 3);
}

TEST_F(Study, HoldsEveryEstimatorToOneRangeOfExponentsUnlessAskedForTheBareOne) {
  options_.splits = 4;
  options_.methods = {"paper", "condition:vertices:pseudo-inverse", "paper-map",
                      "condition:vertices:pseudo-inverse:range=bare",
                      "condition:vertices:map:range=bare"};
  run(options_);
  std::map<std::string, std::vector<double>> error;
  std::istringstream csv(text_of(options_.out / "study.csv"));
  std::string line;
  std::getline(csv, line);
  while (std::getline(csv, line)) {
    const StudyRow row = *study_row_from_csv(line);
    error[row.method].push_back(row.percent_log);
  }
  EXPECT_EQ(error.at("paper"), error.at("condition:vertices:pseudo-inverse"));
  EXPECT_NE(error.at("paper"), error.at("condition:vertices:pseudo-inverse:range=bare"));
  EXPECT_NE(error.at("paper-map"), error.at("condition:vertices:map:range=bare"));
}

TEST_F(Study, ShowsSpheresOfTheTruthAndOfItsEstimates) {
  options_.methods = {"paper", "a-optimal-map"};
  run(options_);
  EXPECT_TRUE(fs::exists(options_.out / "jobs" / "000-sphere.spheres.png"));
  EXPECT_FALSE(fs::exists(options_.out / "jobs" / "001-sphere.spheres.png"));
  EXPECT_THAT(text_of(options_.out / "report.html"),
              testing::HasSubstr("the truth, paper, a-optimal-map"));
}

TEST(ParetoFront, KeepsWhatNoOtherPointBeats) {
  const std::vector<std::pair<double, double>> front =
      pareto_front({{3, 2}, {1, 9}, {2, 10}, {2, 4}, {4, 2}, {5, 1}});
  const std::vector<std::pair<double, double>> expected = {{1, 9}, {2, 4}, {3, 2}, {5, 1}};
  EXPECT_EQ(front, expected);
}

TEST_F(Study, InterruptedGoesOnWithTheJobsThatAreMissingAlone) {
  run(options_);
  const std::string whole = text_of(options_.out / "study.csv");
  fs::remove(options_.out / "jobs" / "001-sphere.csv");
  fs::remove(options_.out / "study.csv");
  std::vector<std::string> done;
  const auto again = run_study(options_, [&](const StudyProgress& p) { done.push_back(p.job); });
  ASSERT_TRUE(again.has_value());
  EXPECT_THAT(done, testing::ElementsAre("sphere split 2"));
  EXPECT_EQ(text_of(options_.out / "study.csv"), whole);
}

TEST_F(Study, GivesTheSameRowsOnTwoThreads) {
  run(options_);
  StudyOptions two = options_;
  two.threads = 2;
  two.out = root_ / "two";
  run(two);
  EXPECT_EQ(text_of(two.out / "study.csv"), text_of(options_.out / "study.csv"));
}

TEST_F(Study, RefusesToMixTwoStudiesInOneFolder) {
  run(options_);
  options_.components = 7;
  const auto other = run_study(options_, nullptr);
  ASSERT_FALSE(other.has_value());
  EXPECT_THAT(other.error().message, testing::HasSubstr("other options"));
}

TEST_F(Study, RefusesOtherNumbersUnderTheSameNames) {
  options_.methods = {"mean"};
  options_.objects = {(root_ / "thing.ply").string()};
  const auto write_mesh = [&](double height) {
    std::ofstream(root_ / "thing.ply")
        << "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty "
           "float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n"
           "1 0 0\n0 1 0\n0 0 "
        << height << "\n3 0 2 1\n3 0 1 3\n3 1 2 3\n3 2 0 3\n";
  };
  const auto message = [&] {
    const auto again = run_study(options_, nullptr);
    return again ? std::string() : again.error().message;
  };
  write_mesh(1);
  run(options_);
  EXPECT_EQ(message(), "");
  write_mesh(1.5);
  EXPECT_THAT(message(), testing::HasSubstr("other options, meshes or materials"));
  write_mesh(1);
  fs::copy_file(root_ / "materials" / "m11.binary", root_ / "materials" / "m10.binary",
                fs::copy_options::overwrite_existing);
  EXPECT_THAT(message(), testing::HasSubstr("other options, meshes or materials"));
}

TEST_F(Study, SaysTheConditionOfThePapersBasisWhateverChoseTheLights) {
  options_.methods = {"pixels-map", "a-optimal-map"};
  run(options_);
  std::map<std::pair<std::string, int>, double> condition;
  std::istringstream csv(text_of(options_.out / "study.csv"));
  std::string line;
  std::getline(csv, line);
  while (std::getline(csv, line)) {
    const StudyRow row = *study_row_from_csv(line);
    if (row.split == 0) condition[{row.method, row.lights}] = row.condition;
  }
  // One light shows 24 rows of three channels: enough for eight stacked components, not for the 35
  // that planning looks at. And no single light has less than the one chosen for it.
  EXPECT_TRUE(std::isfinite(condition.at({"a-optimal-map", 1})));
  EXPECT_GE(condition.at({"a-optimal-map", 1}), condition.at({"pixels-map", 1}));
}

TEST_F(Study, SaysWhatIsWrongWithItsOptions) {
  const auto message = [&](const StudyOptions& o) {
    const auto summary = run_study(o, nullptr);
    return summary ? std::string() : summary.error().message;
  };
  StudyOptions bad = options_;
  bad.methods = {"papre"};
  EXPECT_THAT(message(bad), testing::HasSubstr("there are mean, bivariate, all-samples, random"));
  bad = options_;
  bad.objects = {"spheer"};
  EXPECT_THAT(message(bad), testing::HasSubstr("object spheer: neither a built-in shape"));
  bad = options_;
  bad.materials = (root_ / "nowhere").string();
  EXPECT_THAT(message(bad), testing::HasSubstr("nowhere"));
  bad = options_;
  bad.shard_index = 2;
  bad.shard_count = 2;
  EXPECT_THAT(message(bad), testing::HasSubstr("shard 3 of 2"));
  bad = options_;
  bad.train_fraction = 1;
  EXPECT_THAT(message(bad), testing::HasSubstr("leaves no test"));
}

TEST_F(Study, FindsPlannedLightsBetterThanTheMeanAndMapNoWorseThanThePaper) {
  options_.splits = 4;
  options_.lights = {3};
  run(options_);
  std::map<std::string, double> sum;
  std::istringstream csv(text_of(options_.out / "study.csv"));
  std::string line;
  std::getline(csv, line);
  while (std::getline(csv, line)) {
    const StudyRow row = *study_row_from_csv(line);
    if (row.run == 0) sum[row.method] += row.percent_log;
  }
  EXPECT_LT(sum["paper-map"], 0.5 * sum["mean"]);
  EXPECT_LT(sum["paper-map"], 1.05 * sum["paper"]);
  EXPECT_LT(sum["a-optimal-map"], 0.5 * sum["mean"]);
}

TEST_F(Study, WithNoiseAndOneExposureIsWorseThanWithFive) {
  options_.methods = {"paper-map"};
  options_.lights = {3};
  options_.noise = 0.01;
  const auto error_with = [&](int exposures) {
    StudyOptions o = options_;
    o.exposures = exposures;
    o.out = root_ / fmt::format("exposures{}", exposures);
    run(o);
    double sum = 0;
    std::istringstream csv(text_of(o.out / "study.csv"));
    std::string line;
    std::getline(csv, line);
    while (std::getline(csv, line)) sum += study_row_from_csv(line)->percent_log;
    return sum;
  };
  EXPECT_LE(error_with(5), error_with(1));
}

TEST(LightsOverSphere, CoverItEvenlyAndAreUnit) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const LightPosition& light : lights_over_sphere(1000)) {
    EXPECT_TRUE(light.distant);
    EXPECT_NEAR(light.p.norm(), 1, 1e-12);
    sum += light.p;
  }
  EXPECT_LT(sum.norm() / 1000, 1e-3);
}

TEST(Chart, LeavesOutWhatALogarithmCannotShow) {
  const std::string svg = to_svg(
      {"t", "x", "y", {{"s", {{1, 0}, {2, double{NAN}}, {3, 10}, {4, HUGE_VAL}}}}, false, true});
  EXPECT_THAT(svg, testing::Not(testing::HasSubstr("nan")));
  EXPECT_THAT(svg, testing::Not(testing::HasSubstr("inf")));
  EXPECT_THAT(svg, testing::HasSubstr("<circle"));
}

}  // namespace
}  // namespace lightrig
