#include "core/azimuth_model.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "core/check.h"

namespace lightrig {
namespace {

/// [ln units] A component whose typical effect on a cell is less than this says nothing of φd.
constexpr double faint = 0.05;

/// [1/sr] What is darker than this has no measurable φd.
constexpr double darkest = 1e-6;

/// Departures of one cell from its sums and counts per bin.
void put_departures(Eigen::ArrayXXf& out, int cell, int channel,
                    const std::array<double, azimuth_bins>& sum,
                    const std::array<int, azimuth_bins>& count) {
  double all = 0;
  int values = 0;
  for (std::size_t bin = 0; bin < azimuth_bins; ++bin) {
    all += sum[bin];
    values += count[bin];
  }
  if (values == 0) return;
  const double mean = std::log(std::max(all / values, darkest));
  for (std::size_t bin = 0; bin < azimuth_bins; ++bin) {
    if (count[bin] == 0) continue;
    out(Eigen::Index{cell} * azimuth_bins + static_cast<Eigen::Index>(bin), channel) =
        static_cast<float>(std::log(std::max(sum[bin] / count[bin], darkest)) - mean);
  }
}

int bin_of(double share) {
  return std::clamp(static_cast<int>(share * azimuth_bins), 0, azimuth_bins - 1);
}

}  // namespace

Eigen::ArrayXXf azimuth_departures(const Eigen::ArrayXXd& each, int cells) {
  const Eigen::Index per_cell = each.rows() / cells;
  CHECK(per_cell > 0 && per_cell % azimuth_bins == 0);
  Eigen::ArrayXXf out = Eigen::ArrayXXf::Zero(Eigen::Index{cells} * azimuth_bins, each.cols());
  for (int cell = 0; cell < cells; ++cell) {
    for (int channel = 0; channel < each.cols(); ++channel) {
      std::array<double, azimuth_bins> sum{};
      std::array<int, azimuth_bins> count{};
      for (Eigen::Index k = 0; k < per_cell; ++k) {
        const auto bin = static_cast<std::size_t>(k * azimuth_bins / per_cell);
        sum[bin] += each(cell * per_cell + k, channel);
        ++count[bin];
      }
      put_departures(out, cell, channel, sum, count);
    }
  }
  return out;
}

Eigen::ArrayXXf azimuth_departures(const MerlTable& table) {
  if (table.n_phi < 2 * azimuth_bins) return {};
  const BivariateGrid grid{table.n_h, table.n_d};
  Eigen::ArrayXXf out = Eigen::ArrayXXf::Zero(Eigen::Index{grid.cells()} * azimuth_bins, 3);
  const auto slices = static_cast<std::size_t>(table.n_phi);
  std::vector<std::size_t> bin(slices);
  for (int cell = 0; cell < grid.cells(); ++cell) {
    HalfDiff angles = cell_centre(grid, cell);
    for (std::size_t i = 0; i < slices; ++i) {
      angles.phi_d = (static_cast<double>(i) + 0.5) * std::numbers::pi / table.n_phi;
      bin[i] = static_cast<std::size_t>(bin_of(azimuth_share(angles)));
    }
    for (int channel = 0; channel < 3; ++channel) {
      std::array<double, azimuth_bins> sum{};
      std::array<int, azimuth_bins> count{};
      const std::size_t first =
          (static_cast<std::size_t>(channel) * static_cast<std::size_t>(grid.cells()) +
           static_cast<std::size_t>(cell)) *
          slices;
      for (std::size_t i = 0; i < slices; ++i) {
        const double f = table.f[first + i];
        if (!std::isfinite(f)) continue;
        sum[bin[i]] += f;
        ++count[bin[i]];
      }
      put_departures(out, cell, channel, sum, count);
    }
  }
  return out;
}

double azimuth_share(const HalfDiff& angles) {
  constexpr double half_pi = std::numbers::pi / 2;
  const double phi = angles.phi_d > half_pi ? std::numbers::pi - angles.phi_d : angles.phi_d;
  // Both directions are above the horizon while |cos φd| tan θh tan θd < 1.
  const double tangents = std::tan(angles.theta_h) * std::tan(angles.theta_d);
  const double first = tangents > 1 ? std::acos(1 / tangents) : 0;
  const double range = half_pi - first;
  return range > 1e-9 ? std::clamp((phi - first) / range, 0.0, 1.0) : 1;
}

AzimuthModel::AzimuthModel(std::span<const Material> materials, const BrdfBasis& basis) {
  const bool known = std::all_of(materials.begin(), materials.end(), [&](const Material& m) {
    return m.azimuth.cols() == basis.channels &&
           m.azimuth.rows() == Eigen::Index{basis.grid.cells()} * azimuth_bins;
  });
  if (!known || materials.size() < 3 || basis.layout != ChannelLayout::columns) return;
  const auto n = static_cast<Eigen::Index>(materials.size()) * basis.channels;
  known_ = true;
  departures_.resize(n, materials[0].azimuth.rows());
  Eigen::MatrixXd C(basis.components(), n);
  for (std::size_t m = 0; m < materials.size(); ++m) {
    for (int channel = 0; channel < basis.channels; ++channel) {
      const Eigen::Index at = static_cast<Eigen::Index>(m) * basis.channels + channel;
      departures_.row(at) = materials[m].azimuth.col(channel).matrix().transpose();
      Eigen::VectorXd x = Eigen::VectorXd::Zero(basis.rows());
      for (int cell = 0; cell < basis.grid.cells(); ++cell) {
        if (basis.valid[static_cast<std::size_t>(cell)] == 0) continue;
        x[cell] =
            map_value(basis.mapping, cell, materials[m].table.f(cell, channel)) - basis.mean[cell];
      }
      C.col(at) = basis.V.transpose() * x;
    }
  }
  mean_ = departures_.colwise().mean().transpose();
  departures_.rowwise() -= mean_.transpose();
  // V's columns are orthonormal over the grid: a component of deviation s moves a cell by s/√rows.
  const double tau = static_cast<double>(n * basis.rows()) * faint * faint;
  const Eigen::VectorXd inner = C.rowwise().squaredNorm().array() + tau;
  regression_ = C.transpose() * inner.cwiseInverse().asDiagonal();
  // Residuals of a regression with the own observation left out are r/(1 − h), h its leverage.
  // Components far below τ say nothing and are passed over.
  Eigen::Index kept = 1;
  for (Eigen::Index i = 0; i < inner.size(); ++i) {
    if (inner[i] > 1.01 * tau) kept = i + 1;
  }
  const Eigen::VectorXd leverage =
      1.0 / static_cast<double>(n) + (C.cwiseAbs2().transpose() * inner.cwiseInverse()).array();
  const Eigen::VectorXf grown = (1 - leverage.array()).max(0.05).inverse().cast<float>();
  const Eigen::MatrixXf back = regression_.leftCols(kept).cast<float>();
  const Eigen::MatrixXf onto = C.topRows(kept).cast<float>();
  unsaid_.resize(departures_.cols(), 1);
  constexpr Eigen::Index block = 1024;
  for (Eigen::Index first = 0; first < departures_.cols(); first += block) {
    const auto seen = departures_.middleCols(first, std::min(block, departures_.cols() - first));
    const Eigen::MatrixXf said = back * (onto * seen);
    const Eigen::MatrixXf left = grown.asDiagonal() * (seen - said);
    unsaid_.col(0).segment(first, seen.cols()) =
        left.colwise().squaredNorm().transpose() / static_cast<float>(n);
  }
}

Eigen::Index AzimuthModel::column(int cell, double share) const {
  return Eigen::Index{cell} * azimuth_bins + bin_of(share);
}

Eigen::MatrixXf AzimuthModel::weights(const Eigen::MatrixXd& c) const {
  return (regression_ * c).cast<float>();
}

Eigen::VectorXf AzimuthModel::departure(int cell, double share,
                                        const Eigen::MatrixXf& weights) const {
  CHECK(!none());
  const Eigen::Index at = column(cell, share);
  const auto seen = departures_.col(at);
  const Eigen::VectorXf said = weights.transpose() * seen;
  return said.array().max(seen.minCoeff()).min(seen.maxCoeff()) + mean_[at];
}

std::vector<double> AzimuthModel::variance(std::span<const std::pair<int, double>> places) const {
  CHECK(!none());
  std::vector<double> out;
  out.reserve(places.size());
  for (const auto& [cell, share] : places) out.push_back(double{unsaid_(column(cell, share), 0)});
  return out;
}

}  // namespace lightrig
