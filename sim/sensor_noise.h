#pragma once

#include <optional>
#include <span>
#include <stop_token>

#include "core/image.h"
#include "core/sensor.h"
#include "sim/philox.h"

namespace lightrig::sim {

/// What a linear sensor makes of the radiance on its sites, in the terms of EMVA 1288:
///   electrons = min(Poisson(response · L · t + dark_current · t), full_well) + N(0, read_noise)
///   counts    = round(black_level + electrons / gain), clipped to the 0 … 2^bits − 1 of the ADC.
/// `radiance` (height · width) [W m⁻² sr⁻¹] of each site's own channel; t [s]. Photon noise is
/// exact Poisson at every level. A site's noise depends on (key, site) alone, whatever the number
/// of threads. Empty when stopped. Left out: fixed pattern (PRNU, DSNU), blooming, lag.
std::optional<RawImage> expose_sensor(const SensorModel& sensor, int width, int height,
                                      std::span<const float> radiance, double t, PhiloxKey key,
                                      int threads, const std::stop_token& stop);

/// Expected electrons [e⁻] of one site, without noise or clipping.
double expected_electrons(const SensorModel& sensor, int channel, double radiance, double t);

}  // namespace lightrig::sim
