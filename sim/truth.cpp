#include "sim/truth.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <numbers>
#include <utility>

#include "config/read_bytes.h"
#include "core/builtin_materials.h"
#include "sim/open_devices.h"

namespace lightrig::sim {
namespace {

/// The two cells a coordinate lies between, and the share of the upper one.
struct Between {
  int lower = 0, upper = 0;
  double share = 0;
};

/// `x` in cells from the lower edge; centres lie at i + ½.
Between between_centres(double x, int cells, bool periodic) {
  const double from_centre = x - 0.5;
  if (!periodic) {
    const double held = std::clamp(from_centre, 0.0, static_cast<double>(cells - 1));
    const int lower = std::min(static_cast<int>(held), cells - 1);
    return {lower, std::min(lower + 1, cells - 1), held - lower};
  }
  const double floor = std::floor(from_centre);
  const int lower = ((static_cast<int>(floor) % cells) + cells) % cells;
  return {lower, (lower + 1) % cells, from_centre - floor};
}

Eigen::Array3d interpolate(const MerlTable& table, const HalfDiff& angles) {
  constexpr double half_pi = std::numbers::pi / 2;
  const auto fraction_h = std::sqrt(std::max(0.0, angles.theta_h) / half_pi);
  const Between h = between_centres(table.n_h * fraction_h, table.n_h, false);
  const Between d = between_centres(table.n_d * angles.theta_d / half_pi, table.n_d, false);
  const Between p =
      between_centres(table.n_phi * angles.phi_d / std::numbers::pi, table.n_phi, true);
  Eigen::Array3d sum = Eigen::Array3d::Zero(), weight = Eigen::Array3d::Zero();
  for (int corner = 0; corner < 8; ++corner) {
    const bool up_h = (corner & 1) != 0, up_d = (corner & 2) != 0, up_p = (corner & 4) != 0;
    const double w = (up_h ? h.share : 1 - h.share) * (up_d ? d.share : 1 - d.share) *
                     (up_p ? p.share : 1 - p.share);
    if (!(w > 0)) continue;
    for (int channel = 0; channel < 3; ++channel) {
      const int row = (channel * table.n_h + (up_h ? h.upper : h.lower)) * table.n_d +
                      (up_d ? d.upper : d.lower);
      const auto index = static_cast<std::size_t>(row) * static_cast<std::size_t>(table.n_phi) +
                         static_cast<std::size_t>(up_p ? p.upper : p.lower);
      const double value = table.f[index];
      if (!std::isfinite(value)) continue;
      sum[channel] += w * value;
      weight[channel] += w;
    }
  }
  return (weight > 0).select(sum / weight.max(1e-300), 0.0);
}

Result<Reflectance> read_merl(const std::filesystem::path& path) {
  const auto bytes = read_bytes(path);
  if (!bytes) {
    return fail(bytes.error().code,
                fmt::format("simulated material \"{}\" is neither built in nor a file that can be "
                            "read ({}): `lightrig materials list` names the built-in ones",
                            path.string(), bytes.error().message));
  }
  MerlFindings findings;
  auto table = decode_merl(*bytes, findings);
  if (!table) {
    return tl::unexpected(
        with_context(fmt::format("read simulated material {}", path.string()), table.error()));
  }
  return interpolated(std::move(*table));
}

}  // namespace

Reflectance interpolated(MerlTable table) {
  // std::function copies what it holds: the table is held once for all copies.
  const auto held = std::make_shared<const MerlTable>(std::move(table));
  return [held](const HalfDiff& angles) { return interpolate(*held, angles); };
}

Reflectance as_seen_in_mono(Reflectance reflectance) {
  return [reflectance = std::move(reflectance)](const HalfDiff& angles) -> Eigen::Array3d {
    return Eigen::Array3d::Constant(reflectance(angles).mean());
  };
}

Result<Reflectance> truth_of(const Rig& rig) {
  if (!rig.simulation || rig.simulation->material.empty()) {
    return fail(ErrorCode::invalid_input,
                "the rig file does not say what to simulate: add [simulation] with a material");
  }
  const std::string& name = rig.simulation->material;
  Result<Reflectance> truth;
  if (const BuiltinMaterial* builtin = find_builtin(name)) {
    truth = builtin->reflectance;
  } else {
    truth = read_merl(name);
  }
  if (!truth) return truth;
  const bool mono = rig.camera.sensor.filter == ColorFilter::mono;
  return mono ? as_seen_in_mono(std::move(*truth)) : truth;
}

}  // namespace lightrig::sim
