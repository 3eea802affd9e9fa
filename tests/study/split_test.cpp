#include <gtest/gtest.h>

#include "study/job.h"
#include "tests/core/synthetic_materials.h"

namespace lightrig {
namespace {

TEST(MakeSplit, GivesEveryBasisTheRangeThatMaterialsLeftOutNeed) {
  const std::vector<Material> materials = synthetic_materials(16, BivariateGrid{12, 12}, 3);
  StudyOptions options;
  options.components = 6;
  options.methods = {"a-optimal:pixels:map-stacked"};
  const Result<StudySplit> split = make_split(materials, options, *methods_of(options), 0);
  ASSERT_TRUE(split.has_value()) << split.error().message;
  const BrdfBasis& whole = split->whole;
  EXPECT_GT(whole.range_slack, 0);
  for (const BrdfBasis* other : {&split->paper, &split->priors.at("stacked")}) {
    EXPECT_EQ(other->range_slack, whole.range_slack);
    for (int channel = 0; channel < 3; ++channel) {
      const Eigen::Index first = other->row(0, channel);
      EXPECT_EQ(other->y_min.segment(first, whole.rows()), whole.y_min);
      EXPECT_EQ(other->y_max.segment(first, whole.rows()), whole.y_max);
    }
  }
}

}  // namespace
}  // namespace lightrig
