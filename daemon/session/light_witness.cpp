#include "daemon/session/light_witness.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/half_diff.h"
#include "daemon/session/lit_sites.h"

namespace lightrig {
namespace {

constexpr double sigmas = 5;         ///< noise is believed up to here: one in a million by chance
constexpr double share_open = 0.05;  ///< a lamp's flicker and a sensor's curve within one bracket
constexpr double exposure_open = 1e-5;  ///< [s] what cameras round exposures to (DeviceHand)
constexpr double ambient_open = 0.1;    ///< a room's light may change by this share in a shot
/// Counts so close to white or full well follow light no longer in proportion.
constexpr double linear_share = 0.9;
/// An unseen material may be this much darker than the darkest of the basis.
constexpr double darker_still = 0.25;
/// So many sites at white, where the lamp-off frame is far below it, show light whatever the rest.
constexpr int enough_at_white = 3;

/// [DN] by which black may lie elsewhere than the rig file says.
double black_open(const SensorModel& sensor) {
  return std::max(1.0, 0.5 * sensor.read_noise / sensor.gain);
}

/// The darkest of the materials in that cell, for a channel of the sensor; 0 where none has a
/// value.
double darkest(const std::vector<Material>& materials, int cell, int channel, bool mono) {
  double least = std::numeric_limits<double>::infinity();
  for (const Material& material : materials) {
    const auto row = material.table.f.row(cell);
    const double f = mono ? row.mean() : row[std::min<Eigen::Index>(channel, row.size() - 1)];
    if (f >= 0) least = std::min(least, f);  // false for NaN
  }
  return std::isfinite(least) ? least : 0;
}

}  // namespace

LightWitness::LightWitness(const Rig& rig, const SessionSpec& spec, const Prepared& prepared,
                           int shot, std::vector<std::uint8_t> lit, const Frame& ambient)
    : rig_(rig), spec_(spec), prepared_(prepared), shot_(shot), lit_(std::move(lit)) {
  for (std::size_t site = 0; site < lit_.size(); ++site)
    if (lit_[site] != 0) sites_.push_back(static_cast<std::uint32_t>(site));
  const SensorModel& sensor = rig_.camera.sensor;
  full_ = sensor.white_level() - sensor.black_level;
  if (sensor.full_well > 0) full_ = std::min(full_, sensor.full_well / sensor.gain);
  full_ = sensor.black_level + linear_share * full_;
  ambient_ = view_of(ambient);
}

LightWitness::View LightWitness::view_of(const Frame& frame) const {
  View view{frame.exposure, {}};
  view.counts.reserve(sites_.size());
  for (const std::uint32_t site : sites_) view.counts.push_back(frame.counts.counts[site]);
  return view;
}

double LightWitness::above_black(std::uint16_t count) const {
  return count - rig_.camera.sensor.black_level;
}

/// [DN²] of a count so far above black.
double LightWitness::variance(double signal, double exposure) const {
  const SensorModel& sensor = rig_.camera.sensor;
  const double electrons = std::max(0.0, signal) * sensor.gain + sensor.dark_current * exposure;
  return (electrons + sensor.read_noise * sensor.read_noise) / (sensor.gain * sensor.gain) +
         1.0 / 12.0;
}

std::optional<std::string> LightWitness::contradiction(const Frame& frame) {
  View view = view_of(frame);
  bool seen = false, tells = false;
  if (auto why = unlit(view, seen)) return why;
  for (const View& then : frames_)
    if (auto why = differs(then, view, tells)) return why;
  told_ = tells;
  if (seen || tells) last_seen_ = view.exposure;
  frames_.push_back(std::move(view));
  return std::nullopt;
}

std::optional<double> LightWitness::closing_exposure() const {
  return told_ ? std::nullopt : last_seen_;
}

/// Against the lamp-off frame, scaled to this exposure: is there light of the lamp at all? Where
/// there is none to be seen, it contradicts only if even the darkest material would have shown
/// some.
std::optional<std::string> LightWitness::unlit(const View& now, bool& seen) const {
  const double scale = now.exposure / ambient_.exposure;
  double light = 0, noise = 0, room = 0;
  int used = 0, white = 0;
  for (std::size_t i = 0; i < sites_.size(); ++i) {
    const double off = above_black(ambient_.counts[i]);
    if (ambient_.counts[i] >= full_) continue;
    if (now.counts[i] >= full_) {
      if (scale * off < 0.5 * above_black(static_cast<std::uint16_t>(full_))) ++white;
      continue;
    }
    const double on = above_black(now.counts[i]);
    light += on - scale * off;
    noise += variance(on, now.exposure) + scale * scale * variance(off, ambient_.exposure);
    room += scale * std::max(0.0, off);
    ++used;
  }
  const double allowed = sigmas * std::sqrt(noise) + ambient_open * room +
                         used * black_open(rig_.camera.sensor) * std::abs(1 - scale);
  seen = white >= enough_at_white || light > allowed;
  if (seen || used == 0) return std::nullopt;
  const double least = darker_still * least_rate() * now.exposure;
  if (least <= 2 * allowed) return std::nullopt;
  return fmt::format(
      "lamp: the frame of {:g} s shows no light of it ({:.0f} ± {:.0f} counts over {} sites; the "
      "darkest material of the basis would give {:.0f})",
      now.exposure, light, allowed, used, least / darker_still);
}

/// Against an earlier frame of the same bracket, scaled by the ratio of the exposures. The light of
/// the room is in both and cancels. `tells`: a frame without the lamp's light would have differed.
std::optional<std::string> LightWitness::differs(const View& then, const View& now,
                                                 bool& tells) const {
  const double scale = now.exposure / then.exposure;
  const double ambient_scale = then.exposure / ambient_.exposure;
  double difference = 0, noise = 0, room = 0, promised = 0;
  int used = 0;
  for (std::size_t i = 0; i < sites_.size(); ++i) {
    if (then.counts[i] >= full_ || now.counts[i] >= full_ || ambient_.counts[i] >= full_) continue;
    const double before = above_black(then.counts[i]), after = above_black(now.counts[i]);
    const double off = ambient_scale * above_black(ambient_.counts[i]);
    difference += after - scale * before;
    promised += scale * (before - off);
    noise += variance(after, now.exposure) + scale * scale * variance(before, then.exposure);
    room += scale * std::max(0.0, off);
    ++used;
  }
  const double open = share_open + exposure_open / now.exposure + exposure_open / then.exposure;
  const double allowed = sigmas * std::sqrt(noise) + ambient_open * room +
                         used * black_open(rig_.camera.sensor) * std::abs(1 - scale) +
                         open * std::max(promised, promised + difference);
  if (promised > allowed) tells = true;
  if (std::abs(difference) <= allowed) return std::nullopt;
  return fmt::format(
      "lamp: the frame of {:g} s shows {:.0f} counts of its light over {} sites, that of {:g} s "
      "before it promised {:.0f} ± {:.0f}",
      now.exposure, promised + difference, used, then.exposure, promised, allowed);
}

/// [DN/s] over all lit sites, of the darkest material of the basis.
double LightWitness::least_rate() const {
  const std::vector<LitPoint> points = lit_points(rig_, spec_, prepared_, shot_);
  const SensorModel& sensor = rig_.camera.sensor;
  const LightPosition& light = prepared_.plan.shots[static_cast<std::size_t>(shot_)].light;
  const bool mono = sensor.filter == ColorFilter::mono;
  const auto width = static_cast<std::size_t>(rig_.camera.model.width);
  std::vector<std::uint8_t> left = lit_sites(rig_, points);
  double sum = 0;
  for (const LitPoint& point : points) {
    if (std::exchange(left[point.site], 0) == 0) continue;  // a site counts once
    const Eigen::Vector3d wi = light.direction_from(point.x);
    const int cell = cell_of(prepared_.fit_basis.grid, half_diff(point.n, wi, point.wo));
    const int channel = channel_at(sensor.filter, static_cast<int>(point.site / width),
                                   static_cast<int>(point.site % width));
    const double f = darkest(prepared_.materials, cell, channel, mono);
    sum += f * rig_.lamp.strength[channel] * rig_.lamp.power * light.falloff(point.x) *
           std::max(0.0, point.n.dot(wi)) * sensor.response[channel] / sensor.gain;
  }
  return sum;
}

}  // namespace lightrig
