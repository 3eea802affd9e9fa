#include "core/pose_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include "core/pose_render.h"

namespace lightrig {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

constexpr double unit_turn = std::numbers::pi / 180;
constexpr double unit_shift = 0.02;  // of the object's size
// Half of the difference quotients' steps [units], about the camera's axes: right, down, forward.
// What moves rims by a fraction of a pixel needs large ones, or drowns in the samples' grain.
constexpr double steps[6] = {1, 1, 0.5, 0.5, 0.5, 3};
constexpr double least_step = 0.02;      // [units] below which the search is over
constexpr double longest_step = 1.5;     // [units] of one iteration
constexpr double stale = 0.6;            // [units] from where derivatives were taken
constexpr double wide_prior = 3;         // [units] while searching
constexpr double seen_within = 1.0 / 3;  // [units]
constexpr double model_error = 0.04;     // of a block's value
constexpr double coarse_error = 0.3;     // the same while the pose may be far off
constexpr double slope_error = 0.1;      // of what a block differs from its neighbours
constexpr double floor_share = 0.03;     // of what a lit block has in the middle
constexpr double doubtful = 2;           // [sigma] from where a block counts less
constexpr double shared_error = 4;       // neighbouring blocks err alike: so many count as one
constexpr double azimuth_share = 0.5, tilt_share = 15;  // [1] [1/rad]
constexpr double strange = 5;                           // [sigma]
constexpr int fewest_blocks = 300;                      // lit …
// … and of the object in the picture: lit from behind, rims and grazing highlights are all there is
// to see, and the reflectance there is anybody's guess.
constexpr double least_lit = 0.3;
// By so much every rim may seem to lie farther out, alike at all lights: [px], and of a block's
// edge, since blocks are joined as if light fell on them evenly. Tori of polished metal that lay
// right looked off by 0.15 px with blocks of 4 × 4 pixels, by 0.04 px with 2 × 2.
constexpr double rim_error = 0.05, rim_error_of_block = 0.025;
constexpr int coarse_iterations = 3, iterations = 10;
constexpr int parts = 12;  // across the picture, for the scatter

struct Box {
  Eigen::Vector3d middle;
  double size = 0;  // longest edge
};

Box box_of(const Mesh& mesh) {
  const Eigen::Vector3d low = mesh.vertices.rowwise().minCoeff();
  const Eigen::Vector3d high = mesh.vertices.rowwise().maxCoeff();
  return {(low + high) / 2, (high - low).maxCoeff()};
}

/// The picture's values in blocks; those with a pixel that has no value have none.
struct Values {
  Eigen::VectorXd value, variance;
};

Values joined(const LitPicture& picture, const PoseBlocks& blocks) {
  Values out{Eigen::VectorXd::Zero(blocks.count()), Eigen::VectorXd::Zero(blocks.count())};
  const double pixels = blocks.edge * blocks.edge;
  for (int block = 0; block < blocks.count(); ++block) {
    for (int i = 0; i < blocks.edge * blocks.edge; ++i) {
      const int x = blocks.left + (block % blocks.across) * blocks.edge + i % blocks.edge;
      const int y = blocks.top + (block / blocks.across) * blocks.edge + i / blocks.edge;
      const auto at = static_cast<std::size_t>(y) * static_cast<std::size_t>(picture.width) +
                      static_cast<std::size_t>(x);
      out.value[block] += double{picture.value[at]} / pixels;
      out.variance[block] += double{picture.variance[at]} / (pixels * pixels);
    }
  }
  return out;
}

/// The search for six numbers and a reflectance.
class Search {
 public:
  Search(const PoseRenderer& renderer, const Box& box, const Eigen::Matrix3d& world_from_camera,
         const Values& values, const std::stop_token& stop);

  void run(const PosePicture& modelled);
  /// What the picture says of the units: their inverse covariance, from the scatter of the score.
  Matrix6 said() const;

  PosePicture rendered(const Vector6& at, std::uint32_t grain = 0) const {
    return renderer_.at(motion(at), grain);
  }
  Eigen::Isometry3d motion(const Vector6& at) const;
  const PosePicture& here() const { return here_; }
  double unexplained(const PosePicture& modelled) const;
  Vector6 units() const { return units_; }

 private:
  Eigen::Vector3d shift_of(const Vector6& at) const {
    return unit_shift * box_.size * (world_from_camera_ * at.tail<3>());
  }
  Eigen::VectorXd slopes(const Eigen::VectorXd& explained) const;
  Eigen::VectorXd weights(const Eigen::VectorXd& explained) const;
  void descend(double doubt, int most);
  Vector6 step() const;
  Eigen::VectorXd surface_prior() const;
  void solve_surface(int rounds);
  void differentiate();
  void project_out();

  const PoseRenderer& renderer_;
  const Box& box_;
  const Eigen::Matrix3d world_from_camera_;
  const Values& values_;
  const std::stop_token& stop_;
  double floor_ = 0;  // variance of what nothing can say
  double doubt_ = coarse_error;
  double brightness_ = 0;  // about f in the units of the shares

  Vector6 units_ = Vector6::Zero(), taken_at_ = Vector6::Zero();
  PosePicture here_;
  Eigen::VectorXd surface_ = Eigen::VectorXd::Zero(pose_columns::count);
  Eigen::VectorXd explained_, w_;
  Eigen::MatrixXd jacobian_, again_,
      clear_;  // (blocks × 6); reflectance projected out of the first
  Matrix6 response_ = Matrix6::Zero(), grainy_ = Matrix6::Zero();
};

Search::Search(const PoseRenderer& renderer, const Box& box,
               const Eigen::Matrix3d& world_from_camera, const Values& values,
               const std::stop_token& stop)
    : renderer_(renderer),
      box_(box),
      world_from_camera_(world_from_camera),
      values_(values),
      stop_(stop) {}

Eigen::Isometry3d Search::motion(const Vector6& at) const {
  const Eigen::Vector3d turn = unit_turn * (world_from_camera_ * at.head<3>());
  Eigen::Isometry3d motion = Eigen::Isometry3d::Identity();
  motion.translate(box_.middle + shift_of(at));
  if (turn.norm() > 0) motion.rotate(Eigen::AngleAxisd(turn.norm(), turn.normalized()));
  motion.translate(-box_.middle);
  return motion;
}

Eigen::VectorXd Search::slopes(const Eigen::VectorXd& explained) const {
  const int across = renderer_.blocks().across, down = renderer_.blocks().down;
  Eigen::VectorXd out = Eigen::VectorXd::Zero(explained.size());
  for (int block = 0; block < across * down; ++block) {
    const auto note = [&](int other) {
      const double step = std::abs(explained[block] - explained[other]);
      out[block] = std::max(out[block], step);
      out[other] = std::max(out[other], step);
    };
    if (block % across + 1 < across) note(block + 1);
    if (block / across + 1 < down) note(block + across);
  }
  return out;
}

/// A block's error: noise, what the model lacks, and at rims and highlights where in the block they
/// lie.
Eigen::VectorXd Search::weights(const Eigen::VectorXd& explained) const {
  Eigen::VectorXd w(values_.value.size());
  const Eigen::VectorXd slope = slopes(explained);
  for (Eigen::Index i = 0; i < w.size(); ++i) {
    const double sigma =
        std::sqrt(values_.variance[i] + floor_ + std::pow(slope_error * slope[i], 2) +
                  std::pow(doubt_ * std::max(0.0, explained[i]), 2));
    const double off = std::abs(values_.value[i] - explained[i]) / sigma;
    const double share = doubt_ == coarse_error ? std::min(1.0, doubtful / std::max(off, 1e-9))
                                                : 1 / (1 + std::pow(off / doubtful, 2));
    w[i] = std::isfinite(sigma) ? share / (sigma * sigma) : 0.0;
  }
  return w;
}

/// Inverse variances about zero: runs are held to a share of the reflectance they run about.
Eigen::VectorXd Search::surface_prior() const {
  Eigen::VectorXd precision = Eigen::VectorXd::Zero(pose_columns::count);
  for (int k = 0; k < pose_columns::run_knots; ++k) {
    const double along = static_cast<double>(k) / (pose_columns::run_knots - 1);
    const auto knot = static_cast<Eigen::Index>(
        std::lround(along * static_cast<double>(pose_columns::mean_knots - 1)));
    const double f = std::max(std::abs(surface_[knot]), 1e-6 * brightness_);
    precision[pose_columns::azimuth + k] = std::pow(azimuth_share * f, -2);
    precision[pose_columns::tilt + k] = std::pow(tilt_share * f, -2);
    precision[pose_columns::back + k] = std::pow(std::max(brightness_, 1e-300), -2);
  }
  return precision;
}

/// The reflectance that explains the picture best at this pose.
void Search::solve_surface(int rounds) {
  const Eigen::MatrixXd a = here_.shares.cast<double>();
  for (int round = 0; round < rounds; ++round) {
    const bool fresh = surface_.isZero();
    w_ = weights(fresh ? values_.value : Eigen::VectorXd(a * surface_));
    const Eigen::MatrixXd wa = w_.asDiagonal() * a;
    Eigen::MatrixXd normal = a.transpose() * wa;
    // A touch of ridge, for knots that no point of the surface reaches.
    const double largest = normal.diagonal().maxCoeff();
    const double ridge = 1e-9 * largest + std::numeric_limits<double>::min();
    const Eigen::VectorXd prior =
        fresh ? Eigen::VectorXd::Zero(pose_columns::count) : surface_prior();
    for (Eigen::Index i = 0; i < normal.rows(); ++i) {
      const bool run = i >= pose_columns::azimuth && i < pose_columns::object;
      normal(i, i) += fresh && run ? 1e9 * largest : ridge + prior[i];
    }
    surface_ = normal.ldlt().solve(wa.transpose() * values_.value);
    brightness_ = surface_.head(pose_columns::mean_knots).cwiseAbs().maxCoeff();
  }
  explained_ = a * surface_;
  w_ = weights(explained_);
}

/// Twice, each with samples of its own: what is grain in one is not in the other.
void Search::differentiate() {
  const Eigen::VectorXf f = surface_.cast<float>();
  std::uint32_t grain = 1;
  for (Eigen::MatrixXd* jacobian : {&jacobian_, &again_}) {
    jacobian->setZero(values_.value.size(), 6);
    for (Eigen::Index k = 0; k < 6 && !stop_.stop_requested(); ++k) {
      const Vector6 step = steps[k] * Vector6::Unit(k);
      const Eigen::VectorXf ahead = rendered(units_ + step, grain).shares * f;
      const Eigen::VectorXf behind = rendered(units_ - step, grain).shares * f;
      jacobian->col(k) = (ahead - behind).cast<double>() / (2 * steps[k]);
    }
    ++grain;
  }
  taken_at_ = units_;
}

void Search::project_out() {
  const Eigen::MatrixXd a = here_.shares.cast<double>();
  const Eigen::MatrixXd wa = w_.asDiagonal() * a;
  Eigen::MatrixXd normal = a.transpose() * wa;
  const double ridge = 1e-9 * normal.diagonal().maxCoeff() + std::numeric_limits<double>::min();
  normal.diagonal() += surface_prior();
  normal.diagonal().array() += ridge;
  const Eigen::LDLT<Eigen::MatrixXd> inverse(normal);
  clear_ = jacobian_ - a * inverse.solve(wa.transpose() * jacobian_);
  const Eigen::MatrixXd other = again_ - a * inverse.solve(wa.transpose() * again_);
  const Matrix6 across = clear_.transpose() * w_.asDiagonal() * other;
  response_ = (across + across.transpose()) / 2;
  grainy_ = clear_.transpose() * w_.asDiagonal() * clear_;
  grainy_.diagonal().array() += 1e-9 * grainy_.diagonal().maxCoeff() + 1e-300;
}

/// The score g = Jᵀ W r answers a change of the units by `response_`, in which grain does not
/// count: where nothing is seen it is about zero, however grainy the derivatives are.
Vector6 Search::step() const {
  const Eigen::VectorXd left = values_.value - explained_;
  const double freedom =
      std::max(1.0, static_cast<double>((w_.array() > 0).count()) - pose_columns::count - 6);
  const double scatter = std::max(1.0, left.cwiseAbs2().dot(w_) / freedom) * shared_error;
  const Eigen::LDLT<Matrix6> noise(scatter * grainy_);
  const Vector6 score = clear_.transpose() * (w_.asDiagonal() * left);
  const Matrix6 normal =
      response_ * noise.solve(response_) + Matrix6::Identity() / (wide_prior * wide_prior);
  return normal.ldlt().solve(
      Vector6(response_ * noise.solve(score) - units_ / (wide_prior * wide_prior)));
}

/// Gauss–Newton at one doubt.
void Search::descend(double doubt, int most) {
  doubt_ = doubt;
  solve_surface(3);
  project_out();
  for (int i = 0; i < most && !stop_.stop_requested(); ++i) {
    Vector6 move = step();
    move *= std::min(1.0, longest_step / std::max(move.norm(), 1e-12));
    units_ += move;
    here_ = rendered(units_);
    solve_surface(2);
    if ((units_ - taken_at_).norm() > stale) differentiate();
    project_out();
    if (move.norm() < least_step) break;
  }
}

void Search::run(const PosePicture& modelled) {
  here_ = modelled;
  std::vector<double> lit;
  for (Eigen::Index i = 0; i < values_.value.size(); ++i)
    if (std::isfinite(values_.variance[i]) &&
        modelled.shares.row(i).head(pose_columns::mean_knots).sum() > 0)
      lit.push_back(values_.value[i]);
  if (!lit.empty()) {
    std::nth_element(lit.begin(), lit.begin() + static_cast<std::ptrdiff_t>(lit.size() / 2),
                     lit.end());
    floor_ = std::pow(floor_share * lit[lit.size() / 2], 2);
  }
  solve_surface(3);
  differentiate();
  descend(coarse_error, coarse_iterations);
  descend(model_error, iterations);
}

Matrix6 Search::said() const {
  const PoseBlocks& blocks = renderer_.blocks();
  const Eigen::VectorXd left = values_.value - explained_;
  Eigen::Matrix<double, 6, Eigen::Dynamic> score =
      Eigen::Matrix<double, 6, Eigen::Dynamic>::Zero(6, parts * parts);
  const int edge = std::max(1, (std::max(blocks.across, blocks.down) + parts - 1) / parts);
  for (int block = 0; block < blocks.count(); ++block) {
    const int part = (block / blocks.across / edge) * parts + block % blocks.across / edge;
    score.col(part) += w_[block] * left[block] * clear_.row(block).transpose();
  }
  const Matrix6 scatter = score * score.transpose() + grainy_;
  const Matrix6 said = response_ * scatter.ldlt().solve(response_);
  return (said + said.transpose()) / 2;
}

double Search::unexplained(const PosePicture& modelled) const {
  const Eigen::VectorXd slope = slopes(explained_);
  int strange_ones = 0, all = 0;
  for (Eigen::Index i = 0; i < explained_.size(); ++i) {
    if (!std::isfinite(values_.variance[i]) ||
        !(modelled.shares.row(i).head(pose_columns::mean_knots).sum() > 0))
      continue;
    const double sigma =
        std::sqrt(values_.variance[i] + floor_ + std::pow(slope_error * slope[i], 2) +
                  std::pow(model_error * std::max(0.0, explained_[i]), 2));
    ++all;
    strange_ones += std::abs(values_.value[i] - explained_[i]) > strange * sigma ? 1 : 0;
  }
  return all > 0 ? static_cast<double>(strange_ones) / all : 1;
}

/// How far rims move in the picture with a unit's shift along the line of sight [px].
double rim_motion(const CameraModel& camera, const Box& box) {
  const double depth = (camera.camera_from_world * box.middle).z();
  const double per_m =
      distant(camera) ? 0 : camera.fx / (depth * depth);  // of the distance off axis
  return std::max(1e-9, per_m * box.size / 2 * unit_shift * box.size);
}

double shared_area(const Eigen::VectorXf& a, const Eigen::VectorXf& b) {
  return double{a.cwiseMin(b).sum()} / std::max(1.0, double{a.cwiseMax(b).sum()});
}

}  // namespace

int PoseFit::motions_seen() const {
  return static_cast<int>((deviation.array() < seen_within).count());
}

double PoseFit::seen_of(const Vector6& some) const {
  return (motion.leftCols(motions_seen()).transpose() * some).norm();
}

double PoseFit::deviation_along(const Vector6& direction) const {
  return (deviation.asDiagonal() * (motion.transpose() * direction)).norm();
}

PoseFit fit_pose(const LitPicture& picture, const Mesh& mesh, const Occluder& occluder,
                 const CameraModel& camera, const LightPosition& light, int threads,
                 int most_blocks, const std::stop_token& stop) {
  PoseFit out;
  const PoseRenderer renderer(mesh, occluder, camera, light, most_blocks, threads);
  if (renderer.blocks().count() < fewest_blocks) return out;
  const Box box = box_of(mesh);
  const Values values = joined(picture, renderer.blocks());
  const PosePicture modelled = renderer.at(Eigen::Isometry3d::Identity());
  const auto lit =
      (modelled.shares.leftCols(pose_columns::mean_knots).rowwise().sum().array() > 0).count();
  out.blocks = static_cast<int>(lit);
  const double whole = double{modelled.covered.sum()};
  if (lit < fewest_blocks || static_cast<double>(lit) < least_lit * whole ||
      !(values.value.maxCoeff() > 0))
    return out;
  Search search(renderer, box, camera.camera_from_world.linear().transpose(), values, stop);
  search.run(modelled);
  if (stop.stop_requested()) return out;
  out.unexplained = search.unexplained(modelled);
  out.told = true;
  out.overlap = shared_area(modelled.covered, search.here().covered);
  // Posterior of the units, a priori independent and about one: what is not seen stays zero. The
  // search has shrunk them a little already.
  Matrix6 said = search.said();
  const Eigen::SelfAdjointEigenSolver<Matrix6> but_for_rims(
      Matrix6((said + Matrix6::Identity()).inverse()), Eigen::EigenvaluesOnly);
  out.seen_but_for_rims =
      static_cast<int>((but_for_rims.eigenvalues().array() < seen_within * seen_within).count());
  Matrix6 common = Matrix6::Zero();
  const double rims = std::max(rim_error, rim_error_of_block * renderer.blocks().edge);
  common(5, 5) = std::pow(rims / rim_motion(camera, box), 2);
  said = said * (Matrix6::Identity() + common * said).inverse();
  const Matrix6 spread = (said + Matrix6::Identity()).inverse();
  const Vector6 expected =
      spread * (said + Matrix6::Identity() / (wide_prior * wide_prior)) * search.units();
  const Eigen::SelfAdjointEigenSolver<Matrix6> principal(spread);
  out.deviation = principal.eigenvalues().cwiseMax(0).cwiseSqrt();
  const Eigen::Matrix3d turned = camera.camera_from_world.linear().transpose();
  out.motion.topRows<3>() = turned * principal.eigenvectors().topRows<3>();
  out.motion.bottomRows<3>() = turned * principal.eigenvectors().bottomRows<3>();
  // By what is seen alone: along other motions a rim lit from behind fits a pose a unit away.
  const Eigen::Matrix<double, 6, Eigen::Dynamic> seen =
      principal.eigenvectors().leftCols(out.motions_seen());
  const Vector6 judged = seen * (seen.transpose() * expected);
  out.off = judged.norm();
  const Vector6 towards = judged / std::max(out.off, 1e-12);
  out.sure = out.off - std::sqrt(std::max(0.0, towards.dot(spread * towards)));
  out.judged << turned * judged.head<3>(), turned * judged.tail<3>();
  out.turn = unit_turn * out.judged.head<3>();
  out.shift = unit_shift * box.size * out.judged.tail<3>();
  return out;
}

}  // namespace lightrig
