#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <numeric>
#include <random>

#include "study/job.h"

namespace lightrig {
namespace {

/// A permutation that is the same everywhere: std::shuffle's is not fixed by the standard.
std::vector<std::size_t> permutation(std::size_t n, std::uint64_t seed) {
  std::vector<std::size_t> order(n);
  std::iota(order.begin(), order.end(), 0U);
  std::mt19937_64 random(seed);
  for (std::size_t i = n; i > 1; --i) std::swap(order[i - 1], order[random() % i]);
  return order;
}

BasisOptions prior_options(const std::string& prior, double floor) {
  BasisOptions options;
  options.floor = floor;
  if (prior == "stacked") options.layout = ChannelLayout::stacked;
  if (prior == "ln-offset") options.mapping = Mapping::ln_offset;
  if (prior == "log-relative") options.mapping = Mapping::log_relative;
  return options;
}

/// One range of exponents for every estimator of ln max(f, floor): the training part's over all its
/// channels, as wide as materials left out of it need. Held to a narrower one, a method would be
/// judged by its range and not by its fit.
void share_range(const BrdfBasis& whole, BrdfBasis& other) {
  if (other.mapping.kind != whole.mapping.kind) return;
  const Eigen::Index copies = other.rows() / whole.rows();
  other.y_min = whole.y_min.replicate(copies, 1);
  other.y_max = whole.y_max.replicate(copies, 1);
  other.range_slack = whole.range_slack;
}

}  // namespace

Result<StudySplit> make_split(std::span<const Material> materials, const StudyOptions& options,
                              std::span<const MethodSpec> methods, int index) {
  const auto start = std::chrono::steady_clock::now();
  const auto train = static_cast<std::size_t>(
      std::lround(options.train_fraction * static_cast<double>(materials.size())));
  if (train < 2 || train >= materials.size()) {
    return fail(ErrorCode::invalid_input,
                fmt::format("study: {} of {} materials to learn from leaves no test; choose a "
                            "train_fraction between 2/{} and less than 1",
                            train, materials.size(), materials.size()));
  }
  std::vector<std::size_t> order =
      permutation(materials.size(), options.seed * 1000003 + static_cast<std::uint64_t>(index));
  std::sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(train));
  std::sort(order.begin() + static_cast<std::ptrdiff_t>(train), order.end());
  std::vector<Material> learn;
  StudySplit split;
  split.index = index;
  for (std::size_t i = 0; i < order.size(); ++i) {
    (i < train ? learn : split.test).push_back(materials[order[i]]);
  }
  BasisOptions stacked;
  stacked.layout = ChannelLayout::stacked;
  stacked.components = std::min(options.components, static_cast<int>(train) - 1);
  stacked.floor = options.floor;
  stacked.sigma_folds = 0;
  BasisOptions columns;
  columns.floor = options.floor;
  Result<BrdfBasis> paper = make_basis(learn, stacked);
  Result<BrdfBasis> whole = make_basis(learn, columns);
  if (!paper) return tl::unexpected(with_context("study: basis", paper.error()));
  if (!whole) return tl::unexpected(with_context("study: basis", whole.error()));
  share_range(*whole, *paper);
  split.paper = std::move(*paper);
  split.whole = std::move(*whole);
  for (const MethodSpec& method : methods) {
    if (method.prior.empty() || split.priors.contains(method.prior)) continue;
    Result<BrdfBasis> made = make_basis(learn, prior_options(method.prior, options.floor));
    if (!made) return tl::unexpected(with_context("study: basis " + method.prior, made.error()));
    share_range(split.whole, *made);
    split.priors.emplace(method.prior, std::move(*made));
  }
  split.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  return split;
}

}  // namespace lightrig
