#pragma once

#include <filesystem>

#include "core/calibration_target.h"
#include "core/result.h"
#include "daemon/session/sphere_view.h"

namespace lightrig {

/// A picture as 8-bit grey (PNG, JPEG, TIFF, EXR, …): the mean of its channels, deeper ones scaled
/// from black to their greatest value. Errors: not_found, invalid_input.
Result<GreyImage> read_grey_image(const std::filesystem::path& file);

/// Light from all directions out of a latitude-longitude picture of linear radiance (EXR, HDR): up
/// at its top; its middle column is what stands behind the camera and lights the sphere's front;
/// columns go round to the right as one turns to the right. Errors: not_found; invalid_input for a
/// picture that is not twice as wide as high, or holds no light.
Result<Environment> read_environment(const std::filesystem::path& file);

}  // namespace lightrig
