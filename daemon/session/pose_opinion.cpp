#include "daemon/session/pose_opinion.h"

#include <algorithm>
#include <vector>

#include "daemon/session/pose_check.h"

namespace lightrig {
namespace {

constexpr double sees_within = 1.0 / 3;  // [units] along the motion in question

/// Whether a light that does not agree clears the pose of what `first` said.
bool clears(const PoseFit& first, const PoseFit& next) {
  if (unlike_model(first)) return !unlike_model(next);
  return next.deviation_along(first.judged / first.off) < sees_within;
}

}  // namespace

bool agrees(const PoseFit& first, const PoseFit& next) {
  if (unlike_model(first)) return unlike_model(next);
  const Eigen::Matrix<double, 6, 1> way = first.judged / first.off;
  return next.judged.dot(way) - next.deviation_along(way) > tolerated(next) / 2;
}

PoseOpinion opinion(std::span<const PoseFit> looks) {
  PoseOpinion out;
  std::vector<std::size_t> in_doubt;
  for (std::size_t i = 0; i < looks.size(); ++i) {
    if (!looks[i].told) continue;
    const auto same = std::ranges::find_if(
        in_doubt, [&](std::size_t doubted) { return agrees(looks[doubted], looks[i]); });
    if (same != in_doubt.end()) return {true, *same, i};
    std::erase_if(in_doubt, [&](std::size_t doubted) { return clears(looks[doubted], looks[i]); });
    if (wrong(looks[i])) {
      in_doubt.push_back(i);
    } else if (in_doubt.empty()) {
      return {true, i, std::nullopt};
    }
  }
  out.by = in_doubt.empty() ? looks.size() - 1 : in_doubt.front();
  return out;
}

}  // namespace lightrig
