#include "core/calibration_target.h"

#include <fmt/format.h>

#include <algorithm>
#include <opencv2/aruco/charuco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "core/corner_model.h"

namespace lightrig {
namespace {

constexpr double smallest_marker = 20;  ///< [px] that can be measured

constexpr int fewest_corners = 6;  ///< of a ChArUco board partly seen, and not all in one line

Result<void> check_target(const CalibrationTarget& target) {
  const bool charuco = target.kind == CalibrationTarget::Kind::charuco;
  if (target.columns < 3 || target.rows < 3 || target.columns > 60 || target.rows > 60)
    return fail(ErrorCode::invalid_input,
                fmt::format("a target of {} × {} squares: give between 3 and 60 each way",
                            target.columns, target.rows));
  if (!(target.square > 0) || (charuco && !(target.marker > 0 && target.marker < target.square)))
    return fail(ErrorCode::invalid_input,
                fmt::format("squares of {} m with markers of {} m: both must be above 0, and the "
                            "marker smaller than the square",
                            target.square, target.marker));
  if (charuco && target.columns * target.rows / 2 > 1000)
    return fail(ErrorCode::invalid_input, "a ChArUco board can hold at most 1,000 markers");
  return {};
}

cv::Ptr<cv::aruco::CharucoBoard> board_of(const CalibrationTarget& target) {
  return cv::aruco::CharucoBoard::create(
      target.columns, target.rows, static_cast<float>(target.square),
      static_cast<float>(target.marker),
      cv::aruco::getPredefinedDictionary(cv::aruco::DICT_5X5_1000));
}

Eigen::Vector3d corner_of(const CalibrationTarget& target, int index) {
  const int across = target.columns - 1;
  return {(index % across + 1) * target.square, (index / across + 1) * target.square, 0};
}

/// Corner refinement may not reach over to the next corner: a third of the way, at most 11 px.
int refinement_window(const std::vector<cv::Point2f>& corners) {
  double least = 1e9;
  for (std::size_t i = 0; i < corners.size(); ++i)
    for (std::size_t j = 0; j < i; ++j) least = std::min(least, cv::norm(corners[i] - corners[j]));
  return std::clamp(static_cast<int>(least / 3), 2, 11);
}

void refine(const cv::Mat& image, std::vector<cv::Point2f>& corners) {
  const int half = refinement_window(corners);
  cv::cornerSubPix(image, corners, cv::Size(half, half), cv::Size(-1, -1),
                   cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 100, 1e-4));
}

Result<TargetCorners> find_checkerboard(const cv::Mat& image, const CalibrationTarget& target) {
  std::vector<cv::Point2f> corners;
  const bool found =
      cv::findChessboardCorners(image, cv::Size(target.columns - 1, target.rows - 1), corners,
                                cv::CALIB_CB_ADAPTIVE_THRESH | cv::CALIB_CB_NORMALIZE_IMAGE);
  if (!found)
    return fail(ErrorCode::not_found,
                fmt::format("no checkerboard of {} × {} squares: it must be wholly in the picture, "
                            "sharp and evenly lit, with a white rim",
                            target.columns, target.rows));
  refine(image, corners);
  TargetCorners out;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    out.pixel.emplace_back(double{corners[i].x}, double{corners[i].y});
    out.point.push_back(corner_of(target, static_cast<int>(i)));
  }
  return out;
}

/// How much of a square every marker takes up: its corners brought onto the board by the board's
/// own corners, which do not depend on the marker's size.
std::vector<double> marker_shares(const cv::Mat& image, const CalibrationTarget& target,
                                  const TargetCorners& seen,
                                  std::vector<std::vector<cv::Point2f>> markers) {
  std::vector<cv::Point2d> pixels, squares;
  for (std::size_t i = 0; i < seen.pixel.size(); ++i) {
    pixels.emplace_back(seen.pixel[i].x(), seen.pixel[i].y());
    squares.emplace_back(seen.point[i].x() / target.square, seen.point[i].y() / target.square);
  }
  const cv::Mat onto_board = cv::findHomography(pixels, squares);
  if (onto_board.empty()) return {};  // corners all in one line
  std::vector<double> shares;
  for (std::vector<cv::Point2f>& marker : markers) {
    // Its edge is found some 0.4 px too short: of a small marker that would be an error of its own.
    const double edge = cv::norm(marker[0] - marker[1]);
    if (edge < smallest_marker) continue;
    const int half = std::clamp(static_cast<int>(edge / 8), 1, 5);  // its black rim is a seventh
    cv::cornerSubPix(image, marker, cv::Size(half, half), cv::Size(-1, -1),
                     cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, 1e-3));
    std::vector<cv::Point2f> flat;
    cv::perspectiveTransform(marker, flat, onto_board);
    double round = 0;
    for (std::size_t i = 0; i < 4; ++i) round += cv::norm(flat[i] - flat[(i + 1) % 4]);
    shares.push_back(round / 4);
  }
  return shares;
}

Result<TargetCorners> find_charuco(const cv::Mat& image, const CalibrationTarget& target) {
  const auto board = board_of(target);
  std::vector<int> marker_ids, corner_ids;
  std::vector<std::vector<cv::Point2f>> markers;
  std::vector<cv::Point2f> corners;
  cv::aruco::detectMarkers(image, board->dictionary, markers, marker_ids);
  if (!marker_ids.empty())
    cv::aruco::interpolateCornersCharuco(markers, marker_ids, image, board, corners, corner_ids);
  if (static_cast<int>(corners.size()) < fewest_corners)
    return fail(ErrorCode::not_found,
                fmt::format("{} markers and {} corners of the ChArUco board of {} × {} squares, "
                            "needed are {}: more of it must be in the picture, sharp and evenly "
                            "lit, and the board be the one described",
                            marker_ids.size(), corners.size(), target.columns, target.rows,
                            fewest_corners));
  TargetCorners out;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    out.pixel.emplace_back(double{corners[i].x}, double{corners[i].y});
    out.point.push_back(corner_of(target, corner_ids[i]));
  }
  out.marker_shares = marker_shares(image, target, out, std::move(markers));
  return out;
}

GreyImage grey_of(const cv::Mat& image) {
  GreyImage grey{image.cols, image.rows, {}};
  for (int row = 0; row < image.rows; ++row)
    grey.pixels.insert(grey.pixels.end(), image.ptr<std::uint8_t>(row),
                       image.ptr<std::uint8_t>(row) + image.cols);
  return grey;
}

}  // namespace

Result<TargetCorners> find_corners(const GreyImage& image, const CalibrationTarget& target) {
  if (auto can_be = check_target(target); !can_be) return tl::unexpected(can_be.error());
  cv::Mat pixels(image.height, image.width, CV_8U);
  std::copy(image.pixels.begin(), image.pixels.end(), pixels.ptr<std::uint8_t>(0));
  cv::setNumThreads(1);  // its threads would outlive the call
  try {
    auto corners = target.kind == CalibrationTarget::Kind::charuco
                       ? find_charuco(pixels, target)
                       : find_checkerboard(pixels, target);
    if (!corners) return corners;
    return refined(image, target, std::move(*corners));
  } catch (const cv::Exception& e) {
    return fail(ErrorCode::not_found, fmt::format("looking for the target failed: {}", e.what()));
  }
}

Result<GreyImage> target_image(const CalibrationTarget& target, int pixels_per_square) {
  if (auto can_be = check_target(target); !can_be) return tl::unexpected(can_be.error());
  const int margin = pixels_per_square / 2;
  const cv::Size inner(target.columns * pixels_per_square, target.rows * pixels_per_square);
  if (target.kind == CalibrationTarget::Kind::charuco) {
    cv::Mat image;
    board_of(target)->draw(inner + cv::Size(2 * margin, 2 * margin), image, margin, 1);
    return grey_of(image);
  }
  cv::Mat image(inner.height + 2 * margin, inner.width + 2 * margin, CV_8U, cv::Scalar(255));
  for (int row = 0; row < target.rows; ++row)
    for (int column = row % 2; column < target.columns; column += 2)
      image(cv::Rect(margin + column * pixels_per_square, margin + row * pixels_per_square,
                     pixels_per_square, pixels_per_square)) = 0;
  return grey_of(image);
}

}  // namespace lightrig
