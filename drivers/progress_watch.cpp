#include "drivers/progress_watch.h"

#include <fmt/format.h>

#include <cmath>
#include <utility>

namespace lightrig {
namespace {

/// What an axis may overshoot or be thrown back before it goes the wrong way [rad], [m].
constexpr double rotary_slack = 2 * 0.017453292519943295, linear_slack = 0.005;

}  // namespace

ProgressWatch::ProgressWatch(const GantryModel& model, GantryPosition from, GantryPosition to,
                             TimePoint begun, std::chrono::milliseconds patience)
    : model_(model),
      from_(std::move(from)),
      to_(std::move(to)),
      patience_(patience),
      nearest_((to_.axes - from_.axes).cwiseAbs()),
      progress_(begun) {}

Result<void> ProgressWatch::see(const GantryPosition& position, TimePoint now) {
  bool there = true;
  for (std::size_t i = 0; i < model_.axes.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(i);
    const double way = std::abs(to_.axes[row] - from_.axes[row]);
    const double left = std::abs(to_.axes[row] - position.axes[row]);
    if (left > way + (model_.axes[i].rotary ? rotary_slack : linear_slack))
      return fail(ErrorCode::refused,
                  fmt::format("axis {} goes away from its target: it has {} to go where it had {}; "
                              "look at its sense (the sign of its counts), coupling and encoder",
                              model_.axes[i].name, value_text(model_.axes[i], left, 4),
                              value_text(model_.axes[i], way, 4)));
    if (left < nearest_[row] - tolerance_of(model_, i)) {
      nearest_[row] = left;
      progress_ = now;
    }
    there = there && left <= tolerance_of(model_, i);
  }
  if (there || now - progress_ < patience_) return {};
  return fail(
      ErrorCode::timed_out,
      fmt::format("no axis has come nearer to its target for {:.1f} s: look for what holds it",
                  std::chrono::duration<double>(now - progress_).count()));
}

}  // namespace lightrig
