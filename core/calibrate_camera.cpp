#include "core/calibrate_camera.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

namespace lightrig {
namespace {

constexpr int fewest_views = 4;
constexpr double least_tilt_spread = 15 * std::numbers::pi / 180;
constexpr double least_covered = 0.25;
constexpr double worst_rms = 1.0;           // [px]
constexpr double worst_focal_sigma = 0.01;  // share of the focal length
constexpr int intrinsics = 9, pose = 6;

/// The LAPACK behind OpenCV may be OpenBLAS, whose threads gain nothing on matrices this small and
/// wait for one another for seconds where cores are busy.
void keep_blas_to_one_thread() {
  using SetThreads = void (*)(int);
  static const auto set =
      reinterpret_cast<SetThreads>(dlsym(RTLD_DEFAULT, "openblas_set_num_threads"));
  if (set != nullptr) set(1);
}

/// What OpenCV's optimiser leaves behind.
struct Optimum {
  cv::Mat k = cv::Mat::eye(3, 3, CV_64F), d = cv::Mat::zeros(1, 5, CV_64F);
  std::vector<cv::Mat> turns, shifts;
};

std::vector<cv::Point3f> points_of(const TargetCorners& view) {
  std::vector<cv::Point3f> points;
  for (const Eigen::Vector3d& p : view.point)
    points.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()),
                        static_cast<float>(p.z()));
  return points;
}

Result<Optimum> optimise(std::span<const TargetCorners> views, int width, int height) {
  std::vector<std::vector<cv::Point3f>> points;
  std::vector<std::vector<cv::Point2f>> pixels;
  for (const TargetCorners& view : views) {
    points.push_back(points_of(view));
    pixels.emplace_back();
    for (const Eigen::Vector2d& p : view.pixel)
      pixels.back().emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()));
  }
  Optimum best;
  cv::setNumThreads(1);  // what is to do is small, and its threads would outlive the call
  try {
    cv::calibrateCamera(
        points, pixels, cv::Size(width, height), best.k, best.d, best.turns, best.shifts, 0,
        cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 60, 1e-10));
  } catch (const cv::Exception& e) {
    return fail(ErrorCode::invalid_input, fmt::format("no optimum was found: {}", e.what()));
  }
  return best;
}

/// Residuals of one view, and their derivatives by the intrinsics and by the view's pose.
struct Linearised {
  Eigen::VectorXd residual;  // (2n) [px]
  Eigen::MatrixXd by_camera, by_pose;
};

Linearised linearised(const TargetCorners& view, const Optimum& best, std::size_t index) {
  std::vector<cv::Point2d> seen;
  std::vector<cv::Point3d> points;
  for (const Eigen::Vector3d& p : view.point) points.emplace_back(p.x(), p.y(), p.z());
  cv::Mat jacobian;
  cv::projectPoints(points, best.turns[index], best.shifts[index], best.k, best.d, seen, jacobian);
  Linearised out;
  const Eigen::Index rows = jacobian.rows;
  out.residual.resize(rows);
  out.by_camera.resize(rows, intrinsics);
  out.by_pose.resize(rows, pose);
  for (int row = 0; row < jacobian.rows; ++row) {
    const auto at = static_cast<std::size_t>(row / 2);
    out.residual[row] =
        row % 2 == 0 ? seen[at].x - view.pixel[at].x() : seen[at].y - view.pixel[at].y();
    // OpenCV's columns: turn, shift, fx, fy, cx, cy, distortion.
    for (int c = 0; c < pose; ++c) out.by_pose(row, c) = jacobian.at<double>(row, c);
    for (int c = 0; c < intrinsics; ++c) out.by_camera(row, c) = jacobian.at<double>(row, pose + c);
  }
  return out;
}

Eigen::Isometry3d pose_of(const cv::Mat& turn, const cv::Mat& shift) {
  const Eigen::Vector3d axis(turn.at<double>(0), turn.at<double>(1), turn.at<double>(2));
  Eigen::Isometry3d out = Eigen::Isometry3d::Identity();
  if (axis.norm() > 0) out.linear() = Eigen::AngleAxisd(axis.norm(), axis.normalized()).matrix();
  out.translation() << shift.at<double>(0), shift.at<double>(1), shift.at<double>(2);
  return out;
}

tl::unexpected<Error> refused(std::string why) {
  return fail(ErrorCode::invalid_input, std::move(why));
}

double rms_of(const Linearised& view) {
  return std::sqrt(2 * view.residual.squaredNorm() / static_cast<double>(view.residual.size()));
}

tl::unexpected<Error> far_off(double rms, const std::vector<Linearised>& views) {
  const auto worst = std::ranges::max_element(views, {}, rms_of);
  return refused(fmt::format(
      "the corners lie {:.2f} px (rms) from where any lens of this model would have them, worst in "
      "image {} of {} with {:.2f} px: the target has not so many columns and rows of squares as "
      "was said (--columns, --rows: squares, not inner corners), or is bent, or that image is "
      "blurred; leave it out or take it again",
      rms, worst - views.begin() + 1, views.size(), rms_of(*worst)));
}

/// Residuals and standard errors. The normal matrix is a bordered one: a block of the intrinsics,
/// and a small block for every pose, which is eliminated [Triggs et al. 2000, §6].
Result<void> judge(std::span<const TargetCorners> views, const Optimum& best,
                   CameraCalibration& out) {
  std::vector<Linearised> linear;
  Eigen::MatrixXd reduced = Eigen::MatrixXd::Zero(intrinsics, intrinsics);
  double squares = 0;
  Eigen::Index count = 0;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Linearised& l = linear.emplace_back(linearised(views[i], best, i));
    const Eigen::MatrixXd coupling = l.by_camera.transpose() * l.by_pose;
    const Eigen::MatrixXd own = l.by_pose.transpose() * l.by_pose;
    reduced +=
        l.by_camera.transpose() * l.by_camera - coupling * own.ldlt().solve(coupling.transpose());
    squares += l.residual.squaredNorm();
    count += l.residual.size();
  }
  const Eigen::Index unknowns = intrinsics + pose * static_cast<Eigen::Index>(views.size());
  out.rms = std::sqrt(squares / (static_cast<double>(count) / 2));
  out.noise = std::sqrt(squares / static_cast<double>(std::max<Eigen::Index>(1, count - unknowns)));
  if (out.rms > worst_rms) return far_off(out.rms, linear);
  const Eigen::FullPivLU<Eigen::MatrixXd> lu(reduced);
  if (count <= unknowns || !lu.isInvertible())
    return fail(ErrorCode::invalid_input,
                "the corners do not determine the camera: take more images, with the target tilted "
                "differently in each");
  const Eigen::MatrixXd covariance = out.noise * out.noise * lu.inverse();
  for (int i = 0; i < intrinsics; ++i)
    out.sigma[static_cast<std::size_t>(i)] = std::sqrt(covariance(i, i));
  for (std::size_t i = 0; i < views.size(); ++i) {
    const Linearised& l = linear[i];
    const Eigen::MatrixXd own = l.by_pose.transpose() * l.by_pose;
    const Eigen::MatrixXd inverse = own.inverse();
    const Eigen::MatrixXd gain = inverse * (l.by_pose.transpose() * l.by_camera);
    const Eigen::MatrixXd with_camera =
        out.noise * out.noise * inverse + gain * covariance * gain.transpose();
    ViewFit view;
    view.corners = static_cast<int>(views[i].pixel.size());
    view.rms = rms_of(l);
    for (Eigen::Index k = 0; k < l.residual.size(); k += 2)
      view.worst = std::max(view.worst, std::hypot(l.residual[k], l.residual[k + 1]));
    view.camera_from_target = pose_of(best.turns[i], best.shifts[i]);
    view.pose_covariance = with_camera;
    view.pose_sigma = with_camera.diagonal().cwiseSqrt();
    out.views.push_back(view);
  }
  return {};
}

double hull_share(std::span<const TargetCorners> views, int width, int height) {
  std::vector<cv::Point2f> all, hull;
  for (const TargetCorners& view : views)
    for (const Eigen::Vector2d& p : view.pixel)
      all.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()));
  cv::convexHull(all, hull);
  return cv::contourArea(hull) / (double{1} * width * height);
}

double tilt_spread(const std::vector<ViewFit>& views) {
  double spread = 0;
  for (std::size_t i = 0; i < views.size(); ++i)
    for (std::size_t j = 0; j < i; ++j) {
      const double c = views[i].camera_from_target.linear().col(2).dot(
          views[j].camera_from_target.linear().col(2));
      spread = std::max(spread, std::acos(std::clamp(c, -1.0, 1.0)));
    }
  return spread;
}

Result<void> accept(const CameraCalibration& c) {
  const double degrees = 180 / std::numbers::pi;
  if (c.tilt_spread < least_tilt_spread)
    return refused(fmt::format(
        "the target is tilted by at most {:.1f}° from image to image, so that focal length and "
        "distance cannot be told apart: tilt it by 30° and more, to every side",
        c.tilt_spread * degrees));
  if (c.covered < least_covered)
    return refused(
        fmt::format("the corners reach over {:.0f} % of the picture, so that the "
                    "distortion towards its rim is not determined: bring the target "
                    "into every corner of the picture",
                    100 * c.covered));
  const double focal = c.sigma[0] / c.model.fx;
  if (focal > worst_focal_sigma)
    return refused(
        fmt::format("the focal length is known to {:.1f} % only: take more images, with "
                    "the target larger in the picture and tilted more",
                    100 * focal));
  return {};
}

Eigen::Matrix3d cross(const Eigen::Vector3d& v) {
  Eigen::Matrix3d out;
  out << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return out;
}

}  // namespace

RigPose pose_in_rig(const ViewFit& view, const Eigen::Isometry3d& rig_from_target) {
  RigPose out;
  out.camera_from_rig = view.camera_from_target * rig_from_target.inverse();
  const Eigen::AngleAxisd turn(view.camera_from_target.linear());
  const Eigen::Matrix3d axis = cross(turn.axis());
  const double a = turn.angle();
  // Of a turn vector φ changed by dφ the camera turns by J dφ more, J the left Jacobian of SO(3):
  // 1 + (1 − cos a)/a [n]× + (1 − sin a/a) [n]×².
  Eigen::Matrix3d onwards = Eigen::Matrix3d::Identity();
  if (a > 1e-9) onwards += (1 - std::cos(a)) / a * axis + (1 - std::sin(a) / a) * axis * axis;
  // eye = −Rᵀt, so that d eye = −Rᵀ (dt + [t]× δ) for R turned by δ.
  const Eigen::Matrix3d rig_from_camera = out.camera_from_rig.linear().transpose();
  Eigen::Matrix<double, 6, 6> by = Eigen::Matrix<double, 6, 6>::Zero();
  by.topLeftCorner<3, 3>() = rig_from_camera * onwards;
  by.bottomLeftCorner<3, 3>() =
      -rig_from_camera * cross(view.camera_from_target.translation()) * onwards;
  by.bottomRightCorner<3, 3>() = -rig_from_camera;
  const Eigen::Matrix<double, 6, 1> sigma =
      (by * view.pose_covariance * by.transpose()).diagonal().cwiseMax(0).cwiseSqrt();
  out.turn_sigma = sigma.head<3>();
  out.eye_sigma = sigma.tail<3>();
  return out;
}

Result<CameraCalibration> calibrate_camera(std::span<const TargetCorners> views, int width,
                                           int height) {
  if (static_cast<int>(views.size()) < fewest_views)
    return refused(
        fmt::format("the target was found in {} images; needed are {}, better 15, with "
                    "the target tilted differently in each",
                    views.size(), fewest_views));
  keep_blas_to_one_thread();
  const auto best = optimise(views, width, height);
  if (!best) return tl::unexpected(best.error());
  CameraCalibration out;
  out.model.width = width;
  out.model.height = height;
  out.model.fx = best->k.at<double>(0, 0);
  out.model.fy = best->k.at<double>(1, 1);
  out.model.cx = best->k.at<double>(0, 2);
  out.model.cy = best->k.at<double>(1, 2);
  for (int i = 0; i < 5; ++i)
    out.model.distortion[static_cast<std::size_t>(i)] = best->d.at<double>(i);
  if (auto judged = judge(views, *best, out); !judged) return tl::unexpected(judged.error());
  out.covered = hull_share(views, width, height);
  out.tilt_spread = tilt_spread(out.views);
  out.model.camera_from_world = out.views.front().camera_from_target;
  if (auto accepted = accept(out); !accepted) return tl::unexpected(accepted.error());
  return out;
}

}  // namespace lightrig
