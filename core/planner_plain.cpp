#include <algorithm>

#include "core/planner_chooser.h"

namespace lightrig {

namespace {

class PlainChooser final : public LightChooser {
 public:
  PlainChooser(const BrdfBasis& basis, const CandidateBins& bins, const SelectionOptions& options)
      : basis_(basis),
        bins_(bins),
        options_(options),
        seen_(static_cast<std::size_t>(bins.grid.cells()), 0) {}

  Standing best(const std::vector<std::uint8_t>& open) override {
    std::vector<Standing> standings;
    for (int i = 0; i < bins_.candidates(); ++i) {
      if (open[static_cast<std::size_t>(i)] == 0) continue;
      if (bins_.of(i).empty()) ++statistics_.empty_candidates;
      if (unseen(bins_.of(i), seen_).empty()) continue;
      standings.push_back(standing_with(i));
      ++statistics_.exact_evaluations;
    }
    return best_of(standings);
  }

  void take(std::span<const int> candidates) override {
    for (const int candidate : candidates) {
      for (const std::int32_t cell : bins_.of(candidate)) seen_[static_cast<std::size_t>(cell)] = 1;
    }
  }
  void stand_on(const Eigen::MatrixXd& rows) override { had_ = rows; }
  Standing standing() override { return standing_of(seen_, -1); }
  Eigen::MatrixXd information() const override {
    const Eigen::MatrixXd W = rows_of(seen_) * (basis_.stddev / options_.sigma).asDiagonal();
    return Eigen::MatrixXd::Identity(W.cols(), W.cols()) + W.transpose() * W;
  }
  void restart() override {
    std::fill(seen_.begin(), seen_.end(), 0);
    had_.resize(0, 0);
    statistics_ = {};
  }

  const std::vector<std::uint8_t>& seen() const override { return seen_; }
  const SelectionStatistics& statistics() const override { return statistics_; }

 private:
  Eigen::MatrixXd rows_of(const std::vector<std::uint8_t>& cells) const {
    const Eigen::MatrixXd G = CellRows(basis_).gather(marked(cells));
    if (had_.rows() == 0) return G;
    Eigen::MatrixXd all(had_.rows() + G.rows(), G.cols());
    all << had_, G;
    return all;
  }

  Standing standing_with(int candidate) const {
    std::vector<std::uint8_t> all = seen_;
    for (const std::int32_t cell : bins_.of(candidate)) all[static_cast<std::size_t>(cell)] = 1;
    return standing_of(all, candidate);
  }

  Standing standing_of(const std::vector<std::uint8_t>& all, int candidate) const {
    const Eigen::MatrixXd G = rows_of(all);
    if (options_.criterion == Criterion::a_optimal) {
      return {candidate, 0, posterior_trace(basis_.stddev, G, options_.sigma)};
    }
    const Conditioning found = conditioning_of(singular_values(G), G.rows(), G.cols());
    return {candidate, found.rank, found.pseudo_condition};
  }

  const BrdfBasis& basis_;
  const CandidateBins& bins_;
  const SelectionOptions options_;
  std::vector<std::uint8_t> seen_;
  Eigen::MatrixXd had_;
  SelectionStatistics statistics_;
};

}  // namespace

std::unique_ptr<LightChooser> make_plain_chooser(const BrdfBasis& basis, const CandidateBins& bins,
                                                 const SelectionOptions& options) {
  return std::make_unique<PlainChooser>(basis, bins, options);
}

}  // namespace lightrig
