#include "core/planner.h"

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "core/fit.h"
#include "core/planner_chooser.h"
#include "core/planner_rows.h"

namespace lightrig {

namespace {

/// fit.h's predicted_error_percent at the mean material, for a posterior of MAP. V is orthonormal:
/// for a plain logarithm the trace of the coefficients is all it takes.
double percent_of(const BrdfBasis& basis, const Eigen::LLT<Eigen::MatrixXd>& information) {
  const Eigen::MatrixXd S = basis.stddev.asDiagonal();
  const Eigen::MatrixXd root = information.matrixL().solve(S);
  if (basis.mapping.kind == Mapping::ln_floor) {
    const Eigen::Index channels = basis.rows() / basis.grid.cells();
    return predicted_error_percent(basis, {1, root.squaredNorm(), 0, 0}, basis.mean.squaredNorm(),
                                   channels);
  }
  const Eigen::Index columns = basis.layout == ChannelLayout::stacked ? 1 : basis.channels;
  const std::vector<Eigen::MatrixXd> covariance(static_cast<std::size_t>(columns),
                                                root.transpose() * root);
  return predicted_error_percent(basis, covariance,
                                 Eigen::MatrixXd::Zero(basis.components(), columns));
}

/// The QR factor of the rows of the lights so far, for what the condition criterion's choosers know
/// themselves.
class Factor {
 public:
  explicit Factor(const BrdfBasis& basis) : basis_(basis), R_(0, basis.components()) {}

  void add(std::span<const std::int32_t> cells) { add_rows(CellRows(basis_).gather(cells)); }

  void add_rows(const Eigen::MatrixXd& G) {
    if (G.rows() == 0) return;
    rows_ += G.rows();
    Eigen::MatrixXd stacked(R_.rows() + G.rows(), G.cols());
    stacked << R_, G;
    if (stacked.rows() > G.cols()) {
      const Eigen::HouseholderQR<Eigen::MatrixXd> qr(stacked);
      R_ = qr.matrixQR().topRows(G.cols()).triangularView<Eigen::Upper>();
    } else {
      R_ = stacked;
    }
  }

  Conditioning conditioning() const {
    return conditioning_of(singular_values(R_), rows_, basis_.components());
  }

 private:
  const BrdfBasis& basis_;
  Eigen::MatrixXd R_;
  Eigen::Index rows_ = 0;
};

/// Whether a standing is worth its light after the one before, under the rule.
bool worth_taking(const SelectionOptions& options, const Standing& before, const Standing& next) {
  if (options.stop == StopRule::count || before.candidate < 0) return true;
  if (next.rank != before.rank) return next.rank > before.rank;
  if (options.stop == StopRule::literal) return next.score < before.score;
  return next.score <= (1 - options.plateau) * before.score;
}

SelectedLight reported(const BrdfBasis& basis, const LightChooser& chooser, const Factor& factor,
                       const Standing& standing, int new_cells, Criterion criterion) {
  SelectedLight light;
  light.candidate = standing.candidate;
  light.score = standing.score;
  light.new_cells = new_cells;
  light.predicted_error_percent =
      percent_of(basis, Eigen::LLT<Eigen::MatrixXd>(chooser.information()));
  if (criterion == Criterion::condition) {
    light.rank = standing.rank;
    if (light.rank == basis.components()) light.condition = standing.score;
  } else {
    const Conditioning found = factor.conditioning();
    light.rank = found.rank;
    light.condition = found.condition;
  }
  return light;
}

std::unique_ptr<LightChooser> make_chooser(const BrdfBasis& basis, const CandidateBins& bins,
                                           const SelectionOptions& options) {
  if (options.brute_force) return make_plain_chooser(basis, bins, options);
  if (options.criterion == Criterion::condition) {
    return make_condition_chooser(basis, bins, options);
  }
  return make_a_optimal_chooser(basis, bins, options);
}

}  // namespace

LightPlanner::LightPlanner(const BrdfBasis& basis, const CandidateBins& bins,
                           const SelectionOptions& options)
    : basis_(basis), bins_(bins), chooser_(make_chooser(basis, bins, options)) {
  CHECK(basis.grid == bins.grid);
}
LightPlanner::~LightPlanner() = default;
LightPlanner::LightPlanner(LightPlanner&&) noexcept = default;

/// The chooser as the options have it before any light is chosen.
void LightPlanner::begin(const SelectionOptions& options) {
  CHECK(options.had.rows() == 0 || options.had.cols() == basis_.components());
  if (used_) chooser_->restart();
  used_ = true;
  chooser_->stand_on(options.had);
}

SelectedLight LightPlanner::judge(const SelectionOptions& options) {
  begin(options);
  chooser_->take(options.already);
  Factor factor(basis_);
  if (options.criterion != Criterion::condition) {
    factor.add_rows(options.had);
    factor.add(marked(chooser_->seen()));
  }
  return reported(basis_, *chooser_, factor, chooser_->standing(), 0, options.criterion);
}

Selection LightPlanner::select(const SelectionOptions& options) {
  const auto candidates = static_cast<std::size_t>(bins_.candidates());
  CHECK(options.excluded.empty() || options.excluded.size() == candidates);
  begin(options);
  std::vector<std::uint8_t> open(candidates, 1);
  for (std::size_t i = 0; i < options.excluded.size(); ++i) {
    if (options.excluded[i] != 0) open[i] = 0;
  }
  const bool factored = options.criterion != Criterion::condition;
  Factor factor(basis_);
  if (factored) factor.add_rows(options.had);
  Selection selection;
  selection.mean_only_error_percent =
      percent_of(basis_, Eigen::LLT<Eigen::MatrixXd>(chooser_->information()));
  Standing before;
  for (const int taken : options.already) {
    CHECK(taken >= 0 && taken < bins_.candidates());
    open[static_cast<std::size_t>(taken)] = 0;
  }
  if (!options.already.empty() || options.had.rows() > 0) {
    chooser_->take(options.already);
    if (factored) factor.add(marked(chooser_->seen()));
    before = chooser_->standing();
    if (before.rank > 0 || before.score < std::numeric_limits<double>::infinity()) {
      before.candidate = 0;  // a light of before, whichever
    }
  }
  while (static_cast<int>(selection.lights.size()) < options.max_lights) {
    const Standing next = chooser_->best(open);
    if (next.candidate < 0) break;
    if (!worth_taking(options, before, next)) {
      selection.plateau_reached = true;
      break;
    }
    const std::vector<std::int32_t> fresh = unseen(bins_.of(next.candidate), chooser_->seen());
    if (factored) factor.add(fresh);
    chooser_->take({&next.candidate, 1});
    open[static_cast<std::size_t>(next.candidate)] = 0;
    selection.lights.push_back(reported(basis_, *chooser_, factor, next,
                                        static_cast<int>(fresh.size()), options.criterion));
    before = next;
  }
  selection.statistics = chooser_->statistics();
  return selection;
}

Selection select_lights(const BrdfBasis& basis, const CandidateBins& bins,
                        const SelectionOptions& options) {
  return LightPlanner(basis, bins, options).select(options);
}

Conditioning conditioning(const BrdfBasis& basis, const CandidateBins& bins,
                          std::span<const int> candidates) {
  std::vector<std::uint8_t> seen(static_cast<std::size_t>(bins.grid.cells()), 0);
  for (const int candidate : candidates) {
    for (const std::int32_t cell : bins.of(candidate)) seen[static_cast<std::size_t>(cell)] = 1;
  }
  const Eigen::MatrixXd G = CellRows(basis).gather(marked(seen));
  return conditioning_of(singular_values(G), G.rows(), G.cols());
}

}  // namespace lightrig
