#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "core/candidate_groups.h"
#include "core/matrix_batch.h"

namespace lightrig {

/// For every group of candidates the extreme eigenvectors of A + B, A of the rows taken and B of
/// all unseen rows that any candidate of the group shows, eight groups at a time. Since a candidate
/// adds no more than its group, a group's least eigenvalue bounds those of all its candidates.
class GroupExtremes {
 public:
  /// `groups` must outlive it.
  GroupExtremes(const CandidateGroups& groups, int threads, int level);

  /// After groups.take(): these packed cells are unseen no more.
  void take(std::span<const std::int32_t> cells);

  /// After groups.restart().
  void restart();

  /// Iterates every group's vectors with A = `taken`, an upper triangle (k × stride), and calls
  /// then(group) for each where its vectors are, on whichever thread: to start threads once costs
  /// less than twice.
  void look(std::span<const double> taken, const std::function<void(int)>& then);

  /// What the last look found of a group. Where `known` is false its matrix is not safely positive
  /// definite, and neither vectors nor bound mean anything.
  struct Extremes {
    bool known = false;
    double low = 0;       ///< xᵀ(A + B)x
    double high = 0;      ///< at most yᵀ(A + B)y
    double rounding = 0;  ///< how far either may be off
  };
  Extremes of(int group) const { return found_[static_cast<std::size_t>(group)]; }

  /// A (k × stride, upper triangle) += B of a group.
  void add_group(int group, std::span<double> A) const;

  /// The unit vectors towards which λmin and λmax lie, (stride) each, zeros at the end.
  void copy_vectors(int group, std::span<double> x, std::span<double> y) const;

 private:
  /// Memory that one worker uses again for every batch or group.
  struct Work {
    std::vector<double> A, factor, inverse, z, gram;
    std::vector<std::int32_t> cells;
  };
  /// A group's matrix before anything was taken of it.
  struct Original {
    int group;
    std::vector<double> lower;
  };

  std::size_t batches() const { return (found_.size() + batch_size - 1) / batch_size; }
  double* lane(std::vector<double>& of, std::size_t size, int group) const;
  void sum_group(int group, Work& work);
  void take_from(int group, Work& work);
  void look_at(std::size_t batch, Work& work);
  void iterate_greatest(std::size_t batch, std::span<const double> scale, Work& work);
  void iterate_least(std::size_t batch, std::span<const double> scale, Work& work);

  const CandidateGroups& groups_;
  int k_, stride_, threads_, level_;
  std::vector<double> gram_;           ///< (batches × batch_matrix_size(k))
  std::vector<double> x_, y_;          ///< (batches × batch_vector_size(k))
  std::vector<double> taken_;          ///< A, lower triangle
  std::vector<std::uint8_t> leaving_;  ///< (packed cells): being taken now
  std::vector<Original> originals_;
  std::vector<Extremes> found_;
  std::vector<Work> work_;
};

}  // namespace lightrig
