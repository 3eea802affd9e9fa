#include "core/brdf_table.h"

#include <fmt/format.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>

#include "core/check.h"

namespace lightrig {
namespace {

static_assert(std::endian::native == std::endian::little, "MERL files are little-endian");

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
/// The file holds f divided by these [1/sr]; MERL's own BRDFRead.cpp [Matusik 2003].
constexpr std::array<double, 3> merl_scale = {1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0};
constexpr std::size_t header_bytes = 3 * sizeof(std::int32_t);
constexpr std::int64_t most_cells = std::int64_t{1} << 28;

std::size_t merl_cells(const MerlTable& t) {
  return static_cast<std::size_t>(t.n_h) * static_cast<std::size_t>(t.n_d) *
         static_cast<std::size_t>(t.n_phi);
}

/// Whether both directions of a cell's centre lie above the horizon at this φd. Both z-components
/// are cos θh cos θd ∓ sin θh sin θd cos φd.
bool above_horizon(const HalfDiff& centre, double phi_d) {
  const double straight = std::cos(centre.theta_h) * std::cos(centre.theta_d);
  const double tilt =
      std::sin(centre.theta_h) * std::sin(centre.theta_d) * std::abs(std::cos(phi_d));
  return straight > tilt;
}

double phi_centre(int i, int n) { return (i + 0.5) * std::numbers::pi / n; }

/// Header of a MERL file, checked against the number of bytes that follow it.
Result<MerlTable> decode_header(std::span<const std::byte> bytes) {
  if (bytes.size() < header_bytes) {
    return fail(ErrorCode::invalid_input,
                fmt::format("not a MERL file: {} bytes, but the header alone is {}", bytes.size(),
                            header_bytes));
  }
  std::array<std::int32_t, 3> n{};
  std::memcpy(n.data(), bytes.data(), header_bytes);
  // Dividing the limit keeps the product from overflowing on absurd headers.
  const bool sane = n[0] >= 1 && n[1] >= 1 && n[2] >= 1 && n[0] <= most_cells / n[1] / n[2];
  if (!sane) {
    return fail(ErrorCode::invalid_input,
                fmt::format("absurd MERL header {} × {} × {}: every count must be at least 1 and "
                            "their product at most {} (MERL's own files say 90 × 90 × 180)",
                            n[0], n[1], n[2], most_cells));
  }
  MerlTable table{n[0], n[1], n[2], {}};
  const std::size_t expected = header_bytes + 3 * merl_cells(table) * sizeof(double);
  if (bytes.size() != expected) {
    return fail(ErrorCode::invalid_input,
                fmt::format("MERL file is {}: {} bytes, but its header {} × {} × {} asks for {}",
                            bytes.size() < expected ? "truncated" : "too long", bytes.size(), n[0],
                            n[1], n[2], expected));
  }
  return table;
}

}  // namespace

Result<MerlTable> decode_merl(std::span<const std::byte> bytes, MerlFindings& findings) {
  Result<MerlTable> table = decode_header(bytes);
  if (!table) return table;
  const std::size_t cells = merl_cells(*table);
  table->f.resize(3 * cells);
  std::memcpy(table->f.data(), bytes.data() + header_bytes, 3 * cells * sizeof(double));
  findings = {};
  for (std::size_t channel = 0; channel < 3; ++channel) {
    for (std::size_t i = channel * cells; i < (channel + 1) * cells; ++i) {
      double& f = table->f[i];
      if (!std::isfinite(f)) {
        ++findings.not_a_number;
        f = nan;
      } else if (f < 0) {
        ++findings.negative;
        f = nan;
      } else if (f * merl_scale[channel] > most_reflectance) {
        ++findings.too_large;
        f = nan;
      } else {
        f *= merl_scale[channel];
      }
    }
  }
  return table;
}

std::vector<std::byte> encode_merl(const MerlTable& table) {
  const std::size_t cells = merl_cells(table);
  CHECK(table.f.size() == 3 * cells);
  std::vector<std::byte> bytes(header_bytes + 3 * cells * sizeof(double));
  const std::array<std::int32_t, 3> n = {table.n_h, table.n_d, table.n_phi};
  std::memcpy(bytes.data(), n.data(), header_bytes);
  std::byte* out = bytes.data() + header_bytes;
  for (std::size_t i = 0; i < 3 * cells; ++i, out += sizeof(double)) {
    const double f = table.f[i];
    const double stored = std::isfinite(f) ? f / merl_scale[i / cells] : -1.0;
    std::memcpy(out, &stored, sizeof(double));
  }
  return bytes;
}

BrdfTable to_bivariate(const MerlTable& table) {
  const BivariateGrid grid{table.n_h, table.n_d};
  BrdfTable out{grid, Eigen::ArrayXXd::Constant(grid.cells(), 3, nan)};
  const std::size_t cells = merl_cells(table);
  const auto n_phi = static_cast<std::size_t>(table.n_phi);
  for (int cell = 0; cell < grid.cells(); ++cell) {
    const HalfDiff centre = cell_centre(grid, cell);
    for (int channel = 0; channel < 3; ++channel) {
      const double* f = table.f.data() + static_cast<std::size_t>(channel) * cells +
                        static_cast<std::size_t>(cell) * n_phi;
      double sum = 0;
      int count = 0;
      for (int i = 0; i < table.n_phi; ++i) {
        // A table of one slice is already a mean over φd: its value stands wherever it is valid.
        if (std::isnan(f[i])) continue;
        if (table.n_phi > 1 && !above_horizon(centre, phi_centre(i, table.n_phi))) continue;
        sum += f[i];
        ++count;
      }
      if (count > 0) out.f(cell, channel) = sum / count;
    }
  }
  return out;
}

MerlTable to_merl(const BrdfTable& table, int n_phi) {
  CHECK(n_phi >= 1);
  CHECK(table.f.cols() == 1 || table.f.cols() == 3);
  MerlTable out{table.grid.n_h, table.grid.n_d, n_phi, {}};
  const std::size_t cells = merl_cells(out);
  out.f.assign(3 * cells, nan);
  for (int cell = 0; cell < table.grid.cells(); ++cell) {
    const HalfDiff centre = cell_centre(table.grid, cell);
    for (int i = 0; i < n_phi; ++i) {
      if (n_phi > 1 && !above_horizon(centre, phi_centre(i, n_phi))) continue;
      const std::size_t at = static_cast<std::size_t>(cell) * static_cast<std::size_t>(n_phi) +
                             static_cast<std::size_t>(i);
      for (int channel = 0; channel < 3; ++channel) {
        out.f[static_cast<std::size_t>(channel) * cells + at] =
            table.f(cell, table.f.cols() == 3 ? channel : 0);
      }
    }
  }
  return out;
}

BrdfTable tabulate(const Reflectance& reflectance, const BivariateGrid& grid, int n_phi) {
  CHECK(n_phi >= 1);
  BrdfTable out{grid, Eigen::ArrayXXd::Constant(grid.cells(), 3, nan)};
  for (int cell = 0; cell < grid.cells(); ++cell) {
    HalfDiff angles = cell_centre(grid, cell);
    Eigen::Array3d sum = Eigen::Array3d::Zero();
    int count = 0;
    for (int i = 0; i < n_phi; ++i) {
      angles.phi_d = phi_centre(i, n_phi);
      if (!above_horizon(angles, angles.phi_d)) continue;
      sum += reflectance(angles);
      ++count;
    }
    if (count > 0) out.f.row(cell) = (sum / count).transpose();
  }
  return out;
}

}  // namespace lightrig
