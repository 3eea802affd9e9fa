#pragma once

#include "core/brdf_table.h"

namespace lightrig::sim {

/// A MERL table as a continuous reflectance: trilinear between cell centres in MERL's own warped
/// coordinates, φd periodic, cells without a value left out of the mean. A table with one φd slice
/// is bivariate. Outside the outermost centres the outermost value.
Reflectance interpolated(MerlTable table);

/// What a mono sensor sees of a coloured reflectance: the mean of its channels, in every channel.
Reflectance as_seen_in_mono(Reflectance reflectance);

}  // namespace lightrig::sim
