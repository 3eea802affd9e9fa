#pragma once

#include <cstdint>
#include <functional>

#include "config/rig.h"
#include "core/brdf_basis.h"
#include "daemon/session/prepare.h"

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
  int sets = 5;
  std::uint64_t seed = 1;
  int threads = 1;
  Patience patience = {};  ///< told of each light and each fit; what it returns once stopped says
                           ///< nothing
};

/// The percentage error of the mean of the basis against a reference.
double mean_only_error(const BrdfBasis& basis, const BrdfTable& reference);

/// Draws sets of distinct candidates that show anything at all, photographs each light with the
/// rig's simulated camera (the simulator's shading of `truth`, shadows, mosaic, noise and clipping;
/// every exposure on offer; pixels joined to at most 400,000), merges and extracts as a session
/// does, and reconstructs twice: by the pseudo-inverse with at most 45 components and by MAP with
/// the whole basis, refined. No ambient light; pose and lamp are exact. `lights` is cut to the
/// candidates there are. The result depends on the seed, not on the threads.
RandomLights random_lights(const Rig& rig, const SessionSpec& spec, const Prepared& prepared,
                           const Reflectance& truth, const BrdfTable& reference,
                           const RandomLightsOptions& options);

}  // namespace lightrig
