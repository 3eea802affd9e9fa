#pragma once

#include "core/result.h"
#include "daemon/session/picture.h"
#include "daemon/session/reduction.h"
#include "daemon/session/report.h"
#include "daemon/session/sphere_view.h"

namespace lightrig {

/// Draws every picture of a result from a reduction that kept what pictures need; `reference` may
/// be null; the sphere stands in `surroundings`. Beats with every picture. Errors: those of
/// encoding a PNG.
Result<ResultPictures> draw_pictures(const Reduction& reduction, const Occluder& occluder,
                                     const BrdfTable* reference, const Environment& surroundings,
                                     int threads, const Patience& patience = {});

/// A table and, beside it where there is one, another: ln f of the mean over the channels, in false
/// colour between low and high [1/sr]. θh grows to the right, θd upwards.
Picture table_picture(const BrdfTable& table, const BrdfTable* beside_it, double low, double high);

/// Least and greatest value that a table picture should span [1/sr]: 0.5 % and 99.9 % of the cells.
std::pair<double, double> table_range(const BrdfTable& table, double floor);

/// ln a − ln b of the channel means per cell, values at least `floor`, in the layout of
/// table_picture.
std::vector<float> table_difference(const BrdfTable& a, const BrdfTable& b, double floor);

/// Cell values (cells) in the layout of a table picture: θh to the right, θd upwards.
std::vector<float> as_image(const BivariateGrid& grid, const std::vector<float>& cells);

}  // namespace lightrig
