#include "cli/overlay_words.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <vector>

#include "daemon/session/pose_check.h"
#include "daemon/session/session_folder.h"

namespace lightrig::cli {
namespace {

constexpr const char* another_turn = "planned at another turn of the object than it stands at now";
constexpr const char* nothing_lit = "lights nothing that the camera sees";

std::vector<std::string> names_of(const Plan& plan, const std::vector<int>& shots) {
  std::vector<std::string> names;
  for (const int shot : shots) names.push_back(shot_name(plan, shot));
  return names;
}

}  // namespace

PoseSaid pose_said(const std::string& png, const Rig& rig, const Prepared& prepared,
                   const std::optional<GantryPosition>& at, bool just_lit) {
  if (!just_lit)
    return {"not_told",
            "whether the object lies as modelled is told of a frame taken with the lamp: add "
            "--exposure S --lamp"};
  if (!at) return {"not_told", "pose: the gantry's position is not known"};
  const auto pose = pose_in_preview(png, rig, prepared, *at);
  if (!pose) return {"not_told", "pose: " + pose.error().message};
  if (!pose->told) return {"not_told", "pose: not told, too little of the object is seen or lit"};
  if (wrong(*pose)) return {"wrong", "POSE: " + pose_reason(*pose, false)};
  return {"as_modelled", std::string("pose: as modelled") +
                             (pose->motions_seen() < 6 ? " as far as can be seen, " : ", ") +
                             in_words(*pose)};
}

std::string not_drawn_words(const Plan& plan, const ExpectedHighlights& highlights) {
  std::string words;
  const auto add = [&](const std::vector<int>& shots, const char* why) {
    if (!shots.empty())
      words += fmt::format("not drawn: {}: {}\n", fmt::join(names_of(plan, shots), ", "), why);
  };
  add(highlights.at_another_turn, another_turn);
  add(highlights.lights_nothing, nothing_lit);
  return words;
}

Json overlay_json(const std::string& file, const Plan& plan, const ExpectedHighlights& highlights,
                  const PoseSaid& pose, bool at_home) {
  Json lights = Json::array(), not_drawn = Json::array();
  for (const ExpectedHighlight& one : highlights.seen)
    lights.push_back(
        {{"light", shot_name(plan, one.shot)}, {"column", one.pixel.x()}, {"row", one.pixel.y()}});
  const auto add = [&](const std::vector<int>& shots, const char* why) {
    for (const std::string& name : names_of(plan, shots))
      not_drawn.push_back({{"light", name}, {"why", why}});
  };
  add(highlights.at_another_turn, another_turn);
  add(highlights.lights_nothing, nothing_lit);
  return {{"ok", true},
          {"file", file},
          {"highlights", std::move(lights)},
          {"not_drawn", std::move(not_drawn)},
          {"pose", {{"verdict", pose.verdict}, {"words", pose.words}}},
          {"at_home", at_home}};
}

}  // namespace lightrig::cli
