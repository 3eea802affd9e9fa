#include "cli/progress_view.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace lightrig::cli {
namespace {

using Json = nlohmann::ordered_json;

TEST(StandingWarning, OfAWrongPoseAloneWithItsReason) {
  Json event{{"session", "s"},
             {"seq", 11},
             {"event", "pose"},
             {"fields", {{"name", "L03"}, {"as_modelled", true}}}};
  EXPECT_EQ(standing_warning(event), "");
  event["fields"]["reason"] = "the object does not lie where [object] has it";
  EXPECT_EQ(standing_warning(event),
            "WARNING, at L03: the object does not lie where [object] has it");
  event["event"] = "paused";  // its state says so
  EXPECT_EQ(standing_warning(event), "");
  EXPECT_EQ(standing_warning({{"state", "armed"}}), "");
}

}  // namespace
}  // namespace lightrig::cli
