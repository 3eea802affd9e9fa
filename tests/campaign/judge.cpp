#include "tests/campaign/judge.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "daemon/session/frame_file.h"

namespace lightrig::campaign {

Judge::Judge(const Rig& rig, const sim::World& world) : rig_(rig) {
  for (const sim::ExposureRecord& record : world.records()) by_content_[record.content] = record;
}

std::vector<std::string> Judge::wrong_frames(const std::filesystem::path& session) const {
  std::vector<std::string> wrong;
  const auto record = read_session_folder(session);
  if (!record) return {"the session folder cannot be read: " + record.error().message};
  for (const StoredFrame& frame : record->darks) check(session, frame, nullptr, wrong);
  for (const CapturedShot& shot : record->shots) {
    const Shot& planned = record->plan.shots.at(static_cast<std::size_t>(shot.index));
    for (const StoredFrame& frame : shot.frames) check(session, frame, &planned, wrong);
  }
  return wrong;
}

void Judge::check(const std::filesystem::path& root, const StoredFrame& stored, const Shot* planned,
                  std::vector<std::string>& wrong) const {
  const auto frame = read_frame(root / stored.file);
  if (!frame) return wrong.push_back(stored.file + " cannot be read");
  const auto found = by_content_.find(sim::content_of(frame->counts));
  if (found == by_content_.end())
    return wrong.push_back(stored.file + " is no picture that was taken");
  const sim::ExposureRecord& truth = found->second;
  const bool lamp_off = stored.role == "dark" || stored.role == "ambient";
  const double power = lamp_off ? 0.0 : rig_.lamp.power;
  const double given = truth.moment.lamp_power * truth.moment.lamp_gain;
  if (std::abs(truth.exposure - stored.exposure) > std::max(0.01 * stored.exposure, 1e-5))
    wrong.push_back(fmt::format("{}: exposed for {} s, not {} s", stored.file, truth.exposure,
                                stored.exposure));
  if (std::abs(given - power) > 0.01)
    wrong.push_back(fmt::format("{}: lamp at {}, not {}", stored.file, given, power));
  if (!planned) return;  // a dark frame may be taken anywhere
  const double off = (truth.moment.drives.axes - planned->gantry.axes).cwiseAbs().maxCoeff();
  if (truth.moment.moving || !(off <= 1.05 * rig_.gantry.model.tolerance))
    wrong.push_back(fmt::format("{}: taken {:.4f} rad off{}", stored.file, off,
                                truth.moment.moving ? ", in motion" : ""));
}

}  // namespace lightrig::campaign
