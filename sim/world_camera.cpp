// The laboratory's camera: what the object sends, what the sensor makes of it, and the records.
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>

#include "core/check.h"
#include "sim/sensor_noise.h"
#include "sim/world.h"
#include "sim/world_noise.h"

namespace lightrig::sim {
namespace {

constexpr std::size_t most_records = 65536;

/// A mesh turned about the vertical through a point.
Mesh turned_about(Mesh mesh, const Eigen::Vector3d& centre, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  Eigen::Matrix3d turn;
  turn << c, -s, 0, s, c, 0, 0, 0, 1;
  mesh.vertices = (turn * (mesh.vertices.colwise() - centre)).colwise() + centre;
  mesh.normals = turn * mesh.normals;
  return mesh;
}

}  // namespace

std::uint64_t content_of(const RawImage& image) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  for (const std::uint16_t count : image.counts) {
    hash = (hash ^ (count & 0xffU)) * 0x100000001b3ULL;
    hash = (hash ^ (count >> 8U)) * 0x100000001b3ULL;
  }
  return hash;
}

/// The view of the object turned so far; made anew when a turntable has moved.
const Renderer& World::renderer_at(double turn) {
  if (!seen_ || seen_->first != turn) {
    const auto* table = std::get_if<TurntableKinematics>(&rig_.gantry.model.kinematics);
    CHECK(table != nullptr);
    seen_.emplace(turn, Renderer(turned_about(object_, table->centre, turn), rig_.camera.model,
                                 rig_.camera.sensor.filter, truth_, render_options_));
  }
  return seen_->second;
}

/// Radiance on the sites: the lamp's share is shaded once per lamp position and scaled.
Result<SiteRadiance> World::radiance_at(const SceneMoment& moment, const std::stop_token& stop) {
  const CameraModel& camera = rig_.camera.model;
  const auto sites =
      static_cast<std::size_t>(camera.width) * static_cast<std::size_t>(camera.height);
  SiteRadiance radiance(sites, 0.0F);
  if (moment.lamp_power > 0) {
    const std::lock_guard lock(render_mutex_);
    const bool known = shaded_ && shaded_->light.distant == moment.light.distant &&
                       shaded_->light.p == moment.light.p &&
                       shaded_->light.aim == moment.light.aim && shaded_->turn == moment.turn;
    if (!known) {
      auto image = renderer_at(moment.turn).render(moment.light, rig_.lamp.strength, stop);
      if (!image) return fail(ErrorCode::stopped, "the exposure was stopped");
      shaded_ = Shaded{moment.light, moment.turn, std::move(*image)};
      ++renders_;
    }
    const auto power = static_cast<float>(moment.lamp_power * moment.lamp_gain);
    std::transform(shaded_->radiance.begin(), shaded_->radiance.end(), radiance.begin(),
                   [power](float lit) { return power * lit; });
  }
  const Eigen::Array3d& ambient = rig_.simulation->ambient;
  if ((ambient > 0).any()) {
    std::size_t site = 0;
    for (int row = 0; row < camera.height; ++row) {
      for (int column = 0; column < camera.width; ++column, ++site) {
        const int channel = channel_at(rig_.camera.sensor.filter, row, column);
        radiance[site] += static_cast<float>(ambient[channel]);
      }
    }
  }
  return radiance;
}

Result<Frame> World::expose(const SceneMoment& moment, double exposure,
                            const std::stop_token& stop) {
  const SensorModel& sensor = rig_.camera.sensor;
  if (!(exposure >= sensor.min_exposure && exposure <= sensor.max_exposure)) {
    return fail(ErrorCode::refused,
                fmt::format("exposure {:.6g} s is outside the camera's {:.6g} to {:.6g} s",
                            exposure, sensor.min_exposure, sensor.max_exposure));
  }
  const Result<SiteRadiance> radiance = radiance_at(moment, stop);
  if (!radiance) return tl::unexpected(radiance.error());

  Frame frame;
  frame.exposure = exposure;
  std::vector<std::uint64_t> words = position_words(moment.drives);
  {
    const std::lock_guard lock(mutex_);
    const std::uint64_t repeat = requests_[{moment.lamp_power, exposure}]++;
    frame.id = ++frames_;
    records_.push_back({frame.id, exposure, repeat, moment, 0});
    if (records_.size() > most_records) records_.pop_front();
    words.insert(words.end(), {noise_of_frame, std::bit_cast<std::uint64_t>(moment.lamp_power),
                               std::bit_cast<std::uint64_t>(exposure), take_, repeat});
  }
  auto counts = expose_sensor(sensor, rig_.camera.model.width, rig_.camera.model.height, *radiance,
                              exposure, derive_key(seed_, words), threads_, stop);
  if (!counts) return fail(ErrorCode::stopped, "the exposure was stopped");
  frame.counts = std::move(*counts);
  const std::lock_guard lock(mutex_);
  for (auto record = records_.rbegin(); record != records_.rend(); ++record) {
    if (record->frame_id != frame.id) continue;
    record->content = content_of(frame.counts);
    break;
  }
  return frame;
}

void World::set_take(std::uint64_t take) {
  const std::lock_guard lock(mutex_);
  take_ = take;
}

std::vector<ExposureRecord> World::records() const {
  const std::lock_guard lock(mutex_);
  return {records_.begin(), records_.end()};
}

std::int64_t World::renders() const {
  const std::lock_guard lock(render_mutex_);
  return renders_;
}

}  // namespace lightrig::sim
