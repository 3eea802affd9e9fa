#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "core/brdf_basis.h"
#include "core/brdf_table.h"
#include "core/fit.h"
#include "core/samples.h"

// A pixel that stays black under a light is either in a shadow that no model knows of, or of a
// material that dark. Which of the two, one light cannot tell; the basis and the other lights can.
namespace lightrig {

/// Sites that the camera sees and the lamp lights, as far as the model knows.
std::int64_t lit_sites(const ExtractionStatistics& statistics);
/// Whether so many of them stayed black that something stands before the lamp; fewer may be the
/// pose.
bool stands_in_the_way(const ExtractionStatistics& statistics);

/// The least that any material of the basis shows in each cell, over its channels (cells × 1)
/// [1/sr]; 0 where none has a value.
Eigen::ArrayXXd least_shown(const std::vector<Material>& materials, const BrdfBasis& basis);

/// The least that the material shows (cells × channels) [1/sr]: what the darkest of the basis does
/// (`least_f`, cells × 1), and more where the lights together tell so, three deviations below the
/// estimate. What is not above the mapping's floor there may be anything below it.
Eigen::ArrayXXd surely_shown(const Reconstruction& estimate, const LogMapping& mapping,
                             const Eigen::ArrayXXd& least_f);

/// Whether a material that shows at least `least_f` (cells × 1 or × channels) [1/sr] cannot have
/// left some of the light's pixels black that were believed to be the material.
bool tells_more_blocked(const BrdfObservations& light, const Eigen::ArrayXXd& least_f);

/// The light's observations less the upper bounds of its dark pixels.
BrdfObservations without_dark(const BrdfObservations& light);

/// What to fit, light by light. What stands before the lamp darkens some lights, a dark material
/// all of them: where most lights are mostly black, black is what the material is; else the dark
/// pixels of a light that something stands before bound nothing.
std::vector<BrdfObservations> believed(const std::vector<BrdfObservations>& measured);

}  // namespace lightrig
