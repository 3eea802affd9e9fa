#pragma once

#include <fmt/format.h>

#include <vector>

#include "core/camera_model.h"
#include "daemon/session/journal.h"
#include "tests/session/capture_fixture.h"

// Sessions of five lights before one of which a ball stands that nothing but the simulated
// laboratory knows.
namespace lightrig {

inline const RigChange five_lights{"max_lights = 3", "max_lights = 5"};

inline constexpr double ball_radius = 0.035, ball_distance = 0.2;  // [m]

/// Where a ball stands that takes a light from the object.
inline Eigen::Vector3d ball_before(const LightPosition& light) {
  return ball_distance * light.p.normalized();
}

/// Whether the camera sees the ball: then it takes more than light.
inline bool in_view(const CameraModel& camera, const Eigen::Vector3d& ball) {
  const Eigen::Vector3d seen = camera.camera_from_world * ball;
  const double radius = camera.fx * ball_radius / seen.z();
  const Eigen::Vector2d uv = project(camera, ball);
  return seen.z() > 0 && uv.x() > -radius && uv.x() < camera.width + radius && uv.y() > -radius &&
         uv.y() < camera.height + radius;
}

inline RigChange with_ball(const Eigen::Vector3d& ball) {
  return {"ambient_w_per_m2_sr = 0.002",
          fmt::format("ambient_w_per_m2_sr = 0.002\nobstacle_m = [{}, {}, {}]\n"
                      "obstacle_radius_mm = {}",
                      ball.x(), ball.y(), ball.z(), 1e3 * ball_radius)};
}

inline RigChange with_replan(bool replan) {
  return {"held_out_lights = 1",
          fmt::format("held_out_lights = 1\nreplan = {}\nrandom_baseline = false", replan)};
}

inline std::vector<JournalEvent> replans_of(const SessionFolder& folder) {
  std::vector<JournalEvent> events = replay_journal(folder.journal()).value().events;
  std::erase_if(events, [](const JournalEvent& event) { return event.event != "replanned"; });
  return events;
}

}  // namespace lightrig
