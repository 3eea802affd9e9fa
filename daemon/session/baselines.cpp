#include "daemon/session/baselines.h"

#include <algorithm>
#include <optional>
#include <thread>
#include <utility>

#include "core/brdf_error.h"
#include "core/check.h"
#include "core/extract_demosaiced.h"
#include "core/merge_hdr.h"
#include "core/pixel_neighbours.h"
#include "core/refine.h"
#include "daemon/session/patience.h"
#include "daemon/session/split_mix.h"
#include "sim/philox.h"
#include "sim/sensor_noise.h"
#include "sim/shading.h"

namespace lightrig {
namespace {

constexpr Eigen::Index published_components = 45;
constexpr int footprints_per_row = 24;  // as a session keeps

/// Numbers of one seed, one after another.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}

  std::uint64_t bits() {
    const std::uint64_t number = split_mix(state_);
    state_ += split_mix_step;
    return number;
  }
  // Uniform in (0, 1).
  double uniform() { return (static_cast<double>(bits() >> 11) + 0.5) * 0x1p-53; }
  std::size_t below(std::size_t n) {
    return std::min(n - 1, static_cast<std::size_t>(uniform() * static_cast<double>(n)));
  }

 private:
  std::uint64_t state_;
};

std::vector<int> pick(std::vector<int> candidates, int count, Random& random) {
  for (std::size_t i = 0; i < static_cast<std::size_t>(count); ++i) {
    std::swap(candidates[i], candidates[i + random.below(candidates.size() - i)]);
  }
  candidates.resize(static_cast<std::size_t>(count));
  return candidates;
}

/// The rig's camera with its pixels joined until a picture is quick to make.
CameraModel small_enough(CameraModel camera) {
  constexpr int most_pixels = 400000;
  while (camera.width * camera.height > most_pixels) {
    // Pixel (i, j) has its centre at (i, j): an edge lies half a pixel off.
    camera.width /= 2;
    camera.height /= 2;
    camera.fx /= 2;
    camera.fy /= 2;
    camera.cx = (camera.cx + 0.5) / 2 - 0.5;
    camera.cy = (camera.cy + 0.5) / 2 - 0.5;
  }
  return camera;
}

/// The object as the camera sees it at a position of the gantry, and what renders it. Stays where
/// it was made: the neighbours point to the points.
struct View {
  CameraModel camera;
  SurfacePoints points;
  std::optional<PixelNeighbours> neighbours;
  sim::Renderer renderer;

  View(const Rig& rig, const Prepared& prepared, const Reflectance& truth,
       const RandomLightsOptions& options, const GantryPosition& position)
      : camera(small_enough(camera_at(rig.gantry.model, rig.camera.model, position))),
        renderer(prepared.object.mesh, camera, rig.camera.sensor.filter, truth,
                 {2, options.threads, options.seed}) {
    const Mesh& mesh = prepared.object.mesh;
    const bool same = camera.width == rig.camera.model.width && !turns_object(rig.gantry.model);
    const bool pixels = prepared.points.from_pixels;
    points = same     ? prepared.points
             : pixels ? points_of_pixels(mesh, *prepared.occluder, camera, 1)
                      : points_of_vertices(mesh, *prepared.occluder, camera);
    if (pixels) neighbours.emplace(points, camera.width, camera.height);
  }
  View(const View&) = delete;
  View& operator=(const View&) = delete;
};

/// Everything that the lights' pictures need.
struct Studio {
  const Rig& rig;
  const SessionSpec& spec;
  const Prepared& prepared;
  const Reflectance& truth;
  const RandomLightsOptions& options;
  std::optional<View> standing;  ///< of every light, where the object does not turn

  Studio(const Rig& the_rig, const SessionSpec& the_spec, const Prepared& the_prepared,
         const Reflectance& the_truth, const RandomLightsOptions& the_options)
      : rig(the_rig),
        spec(the_spec),
        prepared(the_prepared),
        truth(the_truth),
        options(the_options) {
    const GantryModel& gantry = rig.gantry.model;
    if (!turns_object(gantry))
      standing.emplace(rig, prepared, truth, options, home_position(gantry));
  }
  Studio(const Studio&) = delete;
  Studio& operator=(const Studio&) = delete;

  BrdfObservations measure(int candidate, std::uint64_t noise_seed) const;
};

/// Renders, exposes, merges and extracts one light, as a capture does; ambient light and dark
/// frames are left out, whose mean the merge knows.
BrdfObservations Studio::measure(int candidate, std::uint64_t noise_seed) const {
  const Candidate& chosen = prepared.candidates[static_cast<std::size_t>(candidate)];
  std::optional<View> turned;
  if (!standing) turned.emplace(rig, prepared, truth, options, chosen.gantry);
  const View& view = standing ? *standing : *turned;
  const CameraModel& camera = view.camera;
  const SensorModel& sensor = rig.camera.sensor;
  const Eigen::Array3d strength = rig.lamp.strength * rig.lamp.power;
  const auto radiance = view.renderer.render(chosen.light, strength, {});
  CHECK(radiance.has_value());
  std::vector<Frame> bracket;
  for (std::size_t i = 0; i < spec.bracket.exposures.size(); ++i) {
    const double t = spec.bracket.exposures[i];
    const std::uint64_t words[] = {static_cast<std::uint64_t>(candidate), i};
    auto counts = sim::expose_sensor(sensor, camera.width, camera.height, *radiance, t,
                                     sim::derive_key(noise_seed, words), 1, {});
    CHECK(counts.has_value());
    bracket.push_back({std::move(*counts), t, i + 1});
  }
  const auto image = merge_hdr(bracket, {}, sensor, MergeOptions{});
  CHECK(image.has_value());
  ExtractOptions extraction;
  extraction.limits = spec.plan.limits;
  extraction.lamp_strength = strength;
  extraction.neighbours = view.neighbours ? &*view.neighbours : nullptr;
  extraction.footprints = footprints_per_row;
  const BrdfBasis& basis = prepared.fit_basis;
  const auto observe = rig.camera.demosaic ? extract_demosaiced : extract;
  return observe(*image, nullptr, view.points, camera, chosen.light, basis.grid, basis.valid,
                 *prepared.occluder, extraction);
}

double error_of(const BrdfBasis& basis, const Coefficients& fitted, const BrdfTable& reference) {
  return brdf_error(evaluate(basis, fitted.c), reference, basis.mapping.floor).percent_log;
}

struct BothErrors {
  double map, pseudo_inverse;  ///< percentage error in ln f
};

/// The published estimator gets the rows as they were measured, as published: corrected for
/// footprint and φd by the MAP estimate, as MAP's are, it does worse still (48 % against 26 % in
/// the demo).
BothErrors errors_of(const BrdfBasis& basis, const BrdfBasis& published,
                     const AzimuthModel& azimuths, std::span<const BrdfObservations> lights,
                     const BrdfTable& reference) {
  const int channels = static_cast<int>(reference.f.cols());
  FitOptions options;
  options.estimator = Estimator::map;
  const Coefficients map = fit_refined(basis, azimuths, lights, channels, options).coefficients;
  options.estimator = Estimator::pseudo_inverse;
  const Coefficients plain = fit_adaptive(published, lights, channels, options).coefficients;
  return {error_of(basis, map, reference), error_of(published, plain, reference)};
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  const std::size_t n = values.size();
  return n % 2 == 1 ? values[n / 2] : 0.5 * (values[n / 2 - 1] + values[n / 2]);
}

}  // namespace

double mean_only_error(const BrdfBasis& basis, const BrdfTable& reference) {
  const bool stacked = basis.layout == ChannelLayout::stacked;
  const Eigen::MatrixXd none =
      Eigen::MatrixXd::Zero(basis.components(), stacked ? 1 : reference.f.cols());
  return brdf_error(evaluate(basis, none), reference, basis.mapping.floor).percent_log;
}

RandomLights random_lights(const Rig& rig, const SessionSpec& spec, const Prepared& prepared,
                           const Reflectance& truth, const BrdfTable& reference,
                           const RandomLightsOptions& options) {
  CHECK(options.sets > 0 && options.threads > 0);
  const Patience& patience = options.patience;
  std::vector<int> candidates;
  for (int i = 0; i < prepared.bins.candidates(); ++i) {
    if (!prepared.bins.of(i).empty()) candidates.push_back(i);
  }
  RandomLights result;
  result.sets = options.sets;
  result.lights = std::min(options.lights, static_cast<int>(candidates.size()));
  const BrdfBasis& basis = prepared.fit_basis;
  const BrdfBasis published = truncated(basis, std::min(published_components, basis.components()));
  result.components = static_cast<int>(published.components());
  const Studio studio(rig, spec, prepared, truth, options);
  const auto sets = static_cast<std::size_t>(options.sets);
  std::vector<double> by_pseudo_inverse(sets), by_map(sets);
  const auto run = [&](std::size_t first, std::size_t stride) {
    for (std::size_t set = first; set < sets; set += stride) {
      const std::uint64_t seed = options.seed * 0x9E3779B97F4A7C15ULL + set;
      Random random(seed);
      std::vector<BrdfObservations> lights;
      for (const int candidate : pick(candidates, result.lights, random)) {
        if (patience.stop.stop_requested()) return;
        lights.push_back(studio.measure(candidate, seed));
        patience.tell();
      }
      const BothErrors errors = errors_of(basis, published, prepared.azimuths, lights, reference);
      patience.tell();
      by_map[set] = errors.map;
      by_pseudo_inverse[set] = errors.pseudo_inverse;
    }
  };
  const auto stride = static_cast<std::size_t>(options.threads);
  {
    std::vector<std::jthread> workers;
    for (std::size_t t = 1; t < stride; ++t) workers.emplace_back(run, t, stride);
    run(0, stride);
  }
  result.pseudo_inverse_percent = median(by_pseudo_inverse);
  result.map_percent = median(by_map);
  return result;
}

}  // namespace lightrig
