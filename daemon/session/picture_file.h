#pragma once

#include <filesystem>

#include "core/calibration_target.h"
#include "core/result.h"
#include "daemon/session/sphere_view.h"

namespace lightrig {

/// A picture as 8-bit grey (PNG, JPEG, TIFF, EXR, …): the mean of its channels. Deeper ones are
/// spread over the greys from what they hold, since counts of 12 bits fill a sixteenth of 16 and
/// those of a session's own frames a millionth of 32; of a frame of a Bayer sensor the four kinds
/// of sites each on its own. Errors: not_found, invalid_input.
Result<GreyImage> read_grey_image(const std::filesystem::path& file);

/// Light from all directions out of a latitude-longitude picture of linear radiance (EXR, HDR): up
/// at its top; its middle column is what stands behind the camera and lights the sphere's front;
/// columns go round to the right as one turns to the right. Errors: not_found; invalid_input for a
/// picture that is not twice as wide as high, or holds no light.
Result<Environment> read_environment(const std::filesystem::path& file);

}  // namespace lightrig
