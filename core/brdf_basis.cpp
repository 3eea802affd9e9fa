#include "core/brdf_basis.h"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "core/basis_training.h"
#include "core/check.h"

namespace lightrig {
namespace {

/// One channel of a material, or the mean of all when a mono camera asks for one.
double training_value(const Material& material, int cell, int channel, int channels) {
  const Eigen::ArrayXXd& f = material.table.f;
  return channels == f.cols() ? f(cell, channel) : f.row(cell).mean();
}

Result<int> training_channels(std::span<const Material> materials, const BasisOptions& options) {
  if (materials.size() < 2) {
    return fail(ErrorCode::invalid_input,
                fmt::format("a basis needs at least 2 materials, {} given", materials.size()));
  }
  const BrdfTable& first = materials.front().table;
  for (const Material& material : materials) {
    const BrdfTable& t = material.table;
    if (!(t.grid == first.grid) || t.f.cols() != first.f.cols()) {
      return fail(ErrorCode::invalid_input,
                  fmt::format("materials on different grids: {} has {} × {} cells and {} channels, "
                              "{} has {} × {} and {}; bring them to one grid first",
                              materials.front().name, first.grid.n_h, first.grid.n_d,
                              first.f.cols(), material.name, t.grid.n_h, t.grid.n_d, t.f.cols()));
    }
  }
  const int available = static_cast<int>(first.f.cols());
  if (options.channels != 0 && options.channels != 1 && options.channels != available) {
    return fail(ErrorCode::invalid_input,
                fmt::format("a basis of {} channels cannot be made of materials with {}",
                            options.channels, available));
  }
  return options.channels == 0 ? available : options.channels;
}

std::vector<std::uint8_t> cells_valid_in_all(std::span<const Material> materials,
                                             const BivariateGrid& grid) {
  std::vector<std::uint8_t> valid(static_cast<std::size_t>(grid.cells()), 1);
  for (const Material& material : materials) {
    for (int cell = 0; cell < grid.cells(); ++cell) {
      if (!material.table.f.row(cell).isFinite().all()) valid[static_cast<std::size_t>(cell)] = 0;
    }
  }
  return valid;
}

/// Nielsen's weight and reference: the cosines at the cell's centre (φd = π/2, where both are
/// cos θh cos θd) and the median over all training values there.
void set_log_relative(BrdfBasis& basis, std::span<const Material> materials) {
  const int cells = basis.grid.cells();
  basis.mapping.weight = Eigen::ArrayXd::Ones(cells);
  basis.mapping.reference = Eigen::ArrayXd::Ones(cells);
  std::vector<double> values;
  for (int cell = 0; cell < cells; ++cell) {
    const HalfDiff centre = cell_centre(basis.grid, cell);
    const double both = std::cos(centre.theta_h) * std::cos(centre.theta_d);
    basis.mapping.weight[cell] = std::max(both * both, 1e-3);
    if (!basis.valid[static_cast<std::size_t>(cell)]) continue;
    values.clear();
    for (const Material& material : materials) {
      for (int channel = 0; channel < basis.channels; ++channel) {
        values.push_back(training_value(material, cell, channel, basis.channels));
      }
    }
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    basis.mapping.reference[cell] = *middle;
  }
}

/// Families numbered in order of appearance; every material by itself unless all have a family and
/// there are at least three.
std::vector<int> leave_out_groups(std::span<const Material> materials) {
  std::vector<std::string> families;
  std::vector<int> groups;
  for (const Material& material : materials) {
    const auto known = std::find(families.begin(), families.end(), material.family);
    groups.push_back(static_cast<int>(known - families.begin()));
    if (known == families.end()) families.push_back(material.family);
  }
  const bool unknown = std::find(families.begin(), families.end(), "") != families.end();
  if (unknown || families.size() < 3) std::iota(groups.begin(), groups.end(), 0);
  return groups;
}

Training training_columns(const BrdfBasis& basis, std::span<const Material> materials) {
  const int cells = basis.grid.cells();
  const bool stacked = basis.layout == ChannelLayout::stacked;
  const Eigen::Index rows = stacked ? Eigen::Index{cells} * basis.channels : Eigen::Index{cells};
  const auto m = static_cast<Eigen::Index>(materials.size());
  const Eigen::Index n = stacked ? m : m * basis.channels;
  Training t{Eigen::MatrixXd::Zero(rows, n), {}, {}, {}, {}, {}, 0};
  const std::vector<int> groups = leave_out_groups(materials);
  t.groups = *std::max_element(groups.begin(), groups.end()) + 1;
  for (Eigen::Index i = 0; i < m; ++i) {
    for (int channel = 0; channel < basis.channels; ++channel) {
      const Eigen::Index column = stacked ? i : i * basis.channels + channel;
      for (int cell = 0; cell < cells; ++cell) {
        if (!basis.valid[static_cast<std::size_t>(cell)]) continue;
        const double f =
            training_value(materials[static_cast<std::size_t>(i)], cell, channel, basis.channels);
        t.X(basis.row(cell, channel), column) = map_value(basis.mapping, cell, f);
      }
      if (stacked && channel > 0) continue;
      t.material_of.push_back(static_cast<int>(i));
      t.group_of.push_back(groups[static_cast<std::size_t>(i)]);
    }
  }
  t.y_min = t.X.rowwise().minCoeff();
  t.y_max = t.X.rowwise().maxCoeff();
  t.mean = t.X.rowwise().mean();
  t.X.colwise() -= t.mean;
  return t;
}

Eigen::MatrixXd gram(const Eigen::MatrixXd& X) {
  Eigen::MatrixXd K = Eigen::MatrixXd::Zero(X.cols(), X.cols());
  K.selfadjointView<Eigen::Lower>().rankUpdate(X.transpose());
  return K.selfadjointView<Eigen::Lower>();
}

/// V = X U Λ^-½, made orthonormal to rounding: small eigenvalues of a Gram matrix carry relative
/// errors of ε λ₁/λᵢ, which one Cholesky step on VᵀV takes out.
Eigen::MatrixXd principal_directions(const Eigen::MatrixXd& X, const GramSpectrum& s,
                                     Eigen::Index k) {
  const Eigen::MatrixXd scaled =
      s.U.leftCols(k) * s.lambda.head(k).cwiseSqrt().cwiseInverse().asDiagonal();
  Eigen::MatrixXd V = X * scaled;
  if (s.lambda[k - 1] < 1e-4 * s.lambda[0]) {
    const Eigen::LLT<Eigen::MatrixXd> llt(gram(V));
    llt.matrixU().solveInPlace<Eigen::OnTheRight>(V);
  }
  for (Eigen::Index i = 0; i < k; ++i) {
    Eigen::Index largest = 0;
    V.col(i).cwiseAbs().maxCoeff(&largest);
    if (V(largest, i) < 0) V.col(i) = -V.col(i);
  }
  return V;
}

}  // namespace

GramSpectrum spectrum(const Eigen::MatrixXd& K, Eigen::Index rows) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(K);
  const Eigen::VectorXd all = solver.eigenvalues().reverse();
  const double least =
      static_cast<double>(rows) * std::numeric_limits<double>::epsilon() * std::max(all[0], 0.0);
  Eigen::Index rank = 0;
  while (rank < all.size() && all[rank] > least) ++rank;
  return {all.head(rank), solver.eigenvectors().rowwise().reverse().leftCols(rank)};
}

double map_value(const LogMapping& mapping, int cell, double f) {
  switch (mapping.kind) {
    case Mapping::ln_floor:
      return std::log(std::max(f, mapping.floor));
    case Mapping::ln_offset:
      return std::log(std::max(f, 0.0) + mapping.floor);
    case Mapping::log_relative: {
      const double w = mapping.weight[cell];
      return std::log((std::max(f, 0.0) * w + mapping.floor) /
                      (mapping.reference[cell] * w + mapping.floor));
    }
  }
  CHECK(false);
}

double unmap_value(const LogMapping& mapping, int cell, double y) {
  switch (mapping.kind) {
    case Mapping::ln_floor:
      return std::exp(y);
    case Mapping::ln_offset:
      return std::max(0.0, std::exp(y) - mapping.floor);
    case Mapping::log_relative: {
      const double w = mapping.weight[cell];
      const double relative = std::exp(y) * (mapping.reference[cell] * w + mapping.floor);
      return std::max(0.0, (relative - mapping.floor) / w);
    }
  }
  CHECK(false);
}

double map_slope(const LogMapping& mapping, int cell, double f) {
  switch (mapping.kind) {
    case Mapping::ln_floor:
      return 1 / std::max(f, mapping.floor);
    case Mapping::ln_offset:
      return 1 / (std::max(f, 0.0) + mapping.floor);
    case Mapping::log_relative: {
      const double w = mapping.weight[cell];
      return w / (std::max(f, 0.0) * w + mapping.floor);
    }
  }
  CHECK(false);
}

Result<BrdfBasis> make_basis(std::span<const Material> materials, const BasisOptions& options) {
  const Result<int> channels = training_channels(materials, options);
  if (!channels) return tl::unexpected(channels.error());
  if (!(options.floor > 0)) {
    return fail(
        ErrorCode::invalid_input,
        fmt::format("the floor of the logarithm must be positive, {} given", options.floor));
  }
  BrdfBasis basis;
  basis.grid = materials.front().table.grid;
  basis.layout = options.layout;
  basis.channels = *channels;
  basis.mapping.kind = options.mapping;
  basis.mapping.floor = options.floor;
  basis.valid = cells_valid_in_all(materials, basis.grid);
  if (options.mapping == Mapping::log_relative) set_log_relative(basis, materials);
  basis.materials = static_cast<int>(materials.size());

  const Training training = training_columns(basis, materials);
  const Eigen::Index n = training.X.cols();
  if (options.components > n - 1) {
    return fail(ErrorCode::invalid_input,
                fmt::format("{} components asked for, but {} training columns support at most {}",
                            options.components, n, n - 1));
  }
  const Eigen::MatrixXd K = gram(training.X);
  const GramSpectrum s = spectrum(K, training.X.rows());
  const Eigen::Index rank = std::min(s.lambda.size(), n - 1);
  if (rank == 0 || options.components > rank) {
    return fail(ErrorCode::invalid_input,
                fmt::format("{} components asked for, but the {} training columns span only {}: "
                            "materials are repeated, or have no valid cell in common",
                            options.components, n, rank));
  }
  const Eigen::Index k = options.components == 0 ? rank : options.components;
  basis.mean = training.mean;
  basis.y_min = training.y_min;
  basis.y_max = training.y_max;
  basis.V = principal_directions(training.X, s, k);
  basis.training_stddev = (s.lambda.head(k) / static_cast<double>(n - 1)).cwiseSqrt();
  basis.stddev = basis.training_stddev;
  basis.variance_captured = s.lambda.head(k).sum() / K.trace();
  if (options.sigma_folds >= 2) {
    const LeaveOut unseen =
        leave_materials_out(basis, training, K, options.sigma_folds, options.threads);
    // An unseen material may lie outside the training range.
    basis.range_slack = unseen.range_slack;
    basis.stddev = unseen.stddev;
    basis.model_sigma = unseen.model_sigma;
    basis.unsaid_sigma = unseen.unsaid_sigma;
    basis.calibration = unseen.calibration;
    basis.left_out = unseen.any;
  }
  return basis;
}

BrdfBasis truncated(const BrdfBasis& basis, Eigen::Index k) {
  CHECK(k >= 1 && k <= basis.components());
  BrdfBasis out = basis;
  out.V = basis.V.leftCols(k);
  out.stddev = basis.stddev.head(k);
  const bool trained = basis.training_stddev.size() == basis.components();
  if (trained) out.training_stddev = basis.training_stddev.head(k);
  const Eigen::VectorXd& spread = trained ? basis.training_stddev : basis.stddev;
  const double kept = spread.head(k).squaredNorm() / spread.squaredNorm();
  out.variance_captured = basis.variance_captured * kept;
  // What the dropped components would have said of an unseen material is now unsaid.
  const auto valid_cells = std::count(basis.valid.begin(), basis.valid.end(), 1);
  const double valid_rows = static_cast<double>(valid_cells * (basis.rows() / basis.grid.cells()));
  const double dropped = basis.stddev.tail(basis.components() - k).squaredNorm();
  out.model_sigma = std::hypot(basis.model_sigma, std::sqrt(dropped / valid_rows));
  out.unsaid_sigma = std::hypot(basis.unsaid_sigma, std::sqrt(dropped / valid_rows));
  return out;
}

BrdfTable evaluate(const BrdfBasis& basis, const Eigen::MatrixXd& c, int* clipped) {
  CHECK(c.rows() == basis.components());
  const bool stacked = basis.layout == ChannelLayout::stacked;
  CHECK(!stacked || c.cols() == 1 || c.cols() == basis.channels);
  const int cells = basis.grid.cells();
  const Eigen::Index channels = stacked ? Eigen::Index{basis.channels} : c.cols();
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  BrdfTable table{basis.grid, Eigen::ArrayXXd::Constant(cells, channels, nan)};
  // One product for all columns of c where they share their rows.
  Eigen::MatrixXd all;
  if (!stacked) all = (basis.V * c).colwise() + basis.mean;
  const Eigen::VectorXd slack = basis.range_slack * (basis.y_max - basis.y_min);
  const Eigen::VectorXd least = basis.y_min - slack, most = basis.y_max + slack;
  int count = 0;
  for (int channel = 0; channel < channels; ++channel) {
    const Eigen::Index first = basis.row(0, channel);
    Eigen::VectorXd y;
    if (stacked) {
      y = basis.mean.segment(first, cells) +
          basis.V.middleRows(first, cells) * c.col(c.cols() == 1 ? 0 : channel);
    } else {
      y = all.col(channel);
    }
    for (int cell = 0; cell < cells; ++cell) {
      if (!basis.valid[static_cast<std::size_t>(cell)]) continue;
      const Eigen::Index row = first + cell;
      // NaN coefficients must not pass for a clipped exponent.
      const double inside = std::clamp(y[cell], least[row], most[row]);
      if (inside != y[cell]) ++count;
      table.f(cell, channel) = unmap_value(basis.mapping, cell, inside);
    }
  }
  if (clipped != nullptr) *clipped = count;
  return table;
}

}  // namespace lightrig
