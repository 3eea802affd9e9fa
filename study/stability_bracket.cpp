// Brackets: exposures a factor of a million apart, and those of which every pixel is saturated or
// black.
#include <cmath>
#include <limits>
#include <span>
#include <vector>

#include "core/merge_hdr.h"
#include "study/stability_cases.h"
#include "study/stability_reference.h"

namespace lightrig {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

Frame frame_of(std::uint16_t counts, double exposure) {
  return {{2, 1, {counts, counts}}, exposure, 1};
}

/// What averaging all exposures' own radiances gives.
double naive_mean(std::span<const Frame> frames, const SensorModel& model) {
  double sum = 0;
  for (const Frame& frame : frames) {
    sum += model.gain * (static_cast<double>(frame.counts.counts[0]) - model.black_level) /
           frame.exposure;
  }
  return sum / static_cast<double>(frames.size());
}

/// The variance of that mean by the signal alone, whatever was saturated.
double naive_variance(std::span<const Frame> frames, const SensorModel& model) {
  double sum = 0;
  for (const Frame& frame : frames) {
    sum += model.gain * (static_cast<double>(frame.counts.counts[0]) - model.black_level) /
           (frame.exposure * frame.exposure);
  }
  return sum / static_cast<double>(frames.size() * frames.size());
}

SensorModel sensor() {
  SensorModel model;
  model.bits = 16;
  model.gain = 1;
  model.black_level = 100;
  model.read_noise = 3;
  model.full_well = 60000;
  model.min_exposure = 1e-9;
  model.max_exposure = 1e9;
  return model;
}

}  // namespace

std::vector<StabilityCase> bracket_cases() {
  std::vector<StabilityCase> cases;
  const SensorModel model = sensor();
  // Radiances that fill each exposure of a bracket of ratio 1e6 to 20,000 electrons in turn.
  const std::vector<Frame> bright = {frame_of(20100, 1e-6), frame_of(65535, 1.0)};
  const Result<RadianceImage> one = merge_hdr(bright, {}, model, {});
  cases.push_back(judged("bracket", "ratio 1e6, the long exposure saturated", 2e10,
                         one ? double{one->L[0]} : 0, naive_mean(bright, model), 1e-6));
  const std::vector<Frame> dim = {frame_of(100, 1e-6), frame_of(20100, 1.0)};
  const Result<RadianceImage> two = merge_hdr(dim, {}, model, {});
  cases.push_back(judged("bracket", "ratio 1e6, the short exposure empty", 2e4,
                         two ? double{two->L[0]} : 0, naive_mean(dim, model), 1e-4));
  const std::vector<Frame> white = {frame_of(65535, 1e-3), frame_of(65535, 1.0)};
  const Result<RadianceImage> three = merge_hdr(white, {}, model, {});
  cases.push_back(judged(
      "bracket", "every frame saturated: said, with infinite variance", infinity,
      three && three->site[0] == RadianceImage::Site::saturated ? double{three->variance[0]} : 0,
      naive_variance(white, model), 0));
  const std::vector<Frame> black = {frame_of(100, 1e-3), frame_of(100, 1.0)};
  const Result<RadianceImage> four = merge_hdr(black, {}, model, {});
  const bool said = four && four->site[0] == RadianceImage::Site::dark &&
                    std::isfinite(four->L[0]) && four->L[0] >= 0;
  cases.push_back(judged("bracket", "every frame black: said, with a finite upper bound", 1,
                         said ? 1 : 0, naive_mean(black, model) > 0 ? 1 : 0, 0));
  // Two honest exposures: the inverse-variance mean, shot and read noise as modelled.
  const std::vector<double> rate = {2000.0 / 0.01, 19900.0 / 0.1};
  const double level = 1.99e5;
  const std::vector<double> variance = {(level * 0.01 + 9 + 1.0 / 12) / (0.01 * 0.01),
                                        (level * 0.1 + 9 + 1.0 / 12) / (0.1 * 0.1)};
  const std::vector<Frame> both = {frame_of(2100, 0.01), frame_of(20000, 0.1)};
  const Result<RadianceImage> five = merge_hdr(both, {}, model, {});
  cases.push_back(judged("bracket", "two good exposures: inverse-variance mean",
                         reference_weighted_mean(rate, variance), five ? double{five->L[0]} : 0,
                         naive_mean(both, model), 1e-6));
  return cases;
}

}  // namespace lightrig
