#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/brdf_basis.h"
#include "core/candidate_bins.h"
#include "core/samples.h"
#include "daemon/session/reduction.h"

namespace lightrig {

/// What as many lights picked at random would have given: medians over the sets.
struct RandomLights {
  double pseudo_inverse_percent = 0;
  double map_percent = 0;
  int sets = 0, lights = 0;
  int components = 0;  ///< of the pseudo-inverse
};

struct RandomLightsOptions {
  int lights = 7;
  int sets = 20;
  std::uint64_t seed = 1;
  int threads = 1;
};

/// The percentage error of the mean of the basis against a reference.
double mean_only_error(const BrdfBasis& basis, const BrdfTable& reference);

/// Relative standard deviations of the values a session measured: the noise that random lights are
/// given too. Sorted.
std::vector<double> relative_noise(std::span<const BrdfObservations> observations);

/// Draws sets of distinct candidates that show anything at all, lets each light measure the
/// reference in its cells with a noise drawn from `noise`, and reconstructs twice: by the
/// pseudo-inverse with at most 45 components and by MAP with the whole basis. `lights` is cut to
/// the candidates there are. The result depends on the seed, not on the threads.
RandomLights random_lights(const BrdfBasis& basis, const CandidateBins& bins,
                           const BrdfTable& reference, std::span<const double> noise,
                           const RandomLightsOptions& options);

}  // namespace lightrig
