#include "daemon/session/calibrate.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>

#include "daemon/session/durable_file.h"
#include "daemon/session/frame_store.h"
#include "daemon/session/picture_file.h"
#include "daemon/session/reduction.h"
#include "daemon/session/session_folder.h"

namespace lightrig {
namespace {

constexpr double degree = std::numbers::pi / 180;
// A diffuse target is not diffuse near the mirror direction, and no target is at grazing angles.
constexpr double least_theta_h = 12 * degree;
constexpr double greatest_theta_d = 50 * degree;
constexpr int fewest_samples = 20;
constexpr double greatest_scatter = 0.05;
// A marker's size off by less is a print measured badly; by more, another print.
constexpr double greatest_marker_error = 0.03;
// Sharp pictures of the target described leave less than half of it.
constexpr double remarkable_rms = 0.2;  // [px]

struct Mean {
  double weight = 0, sum = 0, squares = 0;
  int count = 0;

  void add(double f, double w) {
    weight += w;
    sum += w * f;
    squares += w * f * f;
    ++count;
  }
  double value() const { return sum / weight; }
  double scatter() const {
    return std::sqrt(std::max(0.0, squares / weight - value() * value())) / value();
  }
};

std::vector<Mean> means_of(const Reduction& reduction, const BivariateGrid& grid, int channels) {
  std::vector<Mean> means(static_cast<std::size_t>(channels));
  for (const BrdfObservations& light : reduction.observations()) {
    for (const BrdfObservation& row : light.rows) {
      const HalfDiff angles = cell_centre(grid, row.cell);
      if (row.kind != BrdfObservation::Kind::value || angles.theta_h < least_theta_h ||
          angles.theta_d > greatest_theta_d)
        continue;
      means[static_cast<std::size_t>(row.channel)].add(row.f, row.count);
    }
  }
  return means;
}

Result<void> accept(const std::vector<Mean>& means) {
  for (std::size_t c = 0; c < means.size(); ++c) {
    if (means[c].count < fewest_samples)
      return fail(ErrorCode::invalid_input,
                  fmt::format("only {} samples of the white target away from mirror direction and "
                              "grazing, needed are {}: take more lights, and the target larger in "
                              "the picture",
                              means[c].count, fewest_samples));
    if (means[c].scatter() > greatest_scatter)
      return fail(
          ErrorCode::invalid_input,
          fmt::format("the target's reflectance scatters by {:.1f} % about its mean, allowed "
                      "are {:.0f} %: it is not diffuse, not where [object] has it, or the "
                      "lamp's emission is not as the rig file has it",
                      100 * means[c].scatter(), 100 * greatest_scatter));
  }
  return {};
}

/// Before anything is calibrated: what can be refused at once.
Result<std::optional<TargetInRig>> target_in_rig(const std::optional<BoardPlace>& board,
                                                 const CalibrationTarget& target) {
  if (!board) return std::optional<TargetInRig>();
  if (target.kind == CalibrationTarget::Kind::checkerboard)
    return fail(ErrorCode::invalid_input,
                "a checkerboard looks alike from both of its ends, so that its origin cannot be "
                "told: place a ChArUco board");
  const auto pose = rig_from_target(board->origin, board->columns, board->rows);
  if (!pose) return tl::unexpected(pose.error());
  return TargetInRig{0, *pose};
}

/// One line for each reason, with the pictures that it holds for.
class PassedOver {
 public:
  void add(const std::filesystem::path& file, const std::string& why) {
    std::vector<std::string>& names = names_of_[why];
    if (names.empty()) order_.push_back(why);
    names.push_back(file.filename().string());
  }
  std::vector<std::string> lines() const {
    std::vector<std::string> all;
    for (const std::string& why : order_) {
      const std::vector<std::string>& names = names_of_.at(why);
      all.push_back(names.size() < 4 ? fmt::format("{}: {}", fmt::join(names, ", "), why)
                                     : fmt::format("{} images ({} … {}): {}", names.size(),
                                                   names.front(), names.back(), why));
    }
    return all;
  }

 private:
  std::map<std::string, std::vector<std::string>> names_of_;
  std::vector<std::string> order_;
};

/// The pictures in use, each with the view that it is: a copy is the view of what it copies.
using Shown = std::vector<std::pair<std::filesystem::path, std::size_t>>;

/// Which of the pictures in use the board was placed in. Never another than the one that is meant:
/// what was measured on the rig holds for that picture alone.
Result<std::size_t> view_of(const BoardPlace& board,
                            const std::vector<std::filesystem::path>& images, const Shown& shown) {
  const std::filesystem::path& meant = board.image.empty() ? images.front() : board.image;
  const auto at = std::ranges::find(shown, meant, &Shown::value_type::first);
  if (at == shown.end())
    return fail(ErrorCode::invalid_input,
                fmt::format("the board is placed in \"{}\", {}: take that picture again, or name "
                            "another whose board you have measured (--board-image)",
                            meant.string(),
                            std::ranges::find(images, meant) == images.end()
                                ? "which is none of the pictures"
                                : "in which it was not found"));
  return at->second;
}

/// The board's scale is the square's as given, and nothing else says that it is right: but a print
/// of another size shows other markers too.
Result<void> check_marker(const std::vector<TargetCorners>& views,
                          const CalibrationTarget& target) {
  std::vector<double> shares;
  for (const TargetCorners& view : views)
    shares.insert(shares.end(), view.marker_shares.begin(), view.marker_shares.end());
  if (shares.empty()) return {};
  const auto middle = shares.begin() + static_cast<std::ptrdiff_t>(shares.size() / 2);
  std::nth_element(shares.begin(), middle, shares.end());
  const double given = target.marker / target.square;
  if (std::abs(*middle / given - 1) <= greatest_marker_error) return {};
  return fail(ErrorCode::invalid_input,
              fmt::format("the markers' edges are {:.3f} of the squares' in the pictures, by the "
                          "sizes given {:g} mm of {:g} mm, {:.3f}: measure a square and a marker "
                          "of the print (--square-mm, --marker-mm)",
                          *middle, 1000 * target.marker, 1000 * target.square, given));
}

}  // namespace

Result<CalibrationRun> calibrate_camera_from(const std::vector<std::filesystem::path>& images,
                                             const CalibrationTarget& target,
                                             const std::optional<BoardPlace>& board) {
  CalibrationRun run;
  auto placed = target_in_rig(board, target);
  if (!placed) return tl::unexpected(placed.error());
  run.placed = *placed;
  PassedOver passed_over;
  std::vector<TargetCorners> views;
  Shown shown;
  int width = 0, height = 0;
  for (const std::filesystem::path& file : images) {
    const auto image = read_grey_image(file);
    if (!image) return tl::unexpected(image.error());
    if (width != 0 && (image->width != width || image->height != height))
      return fail(
          ErrorCode::invalid_input,
          fmt::format("\"{}\" is {} × {} px, those before it {} × {}: all must come from one "
                      "camera at one setting",
                      file.string(), image->width, image->height, width, height));
    width = image->width;
    height = image->height;
    const auto bytes = read_file(file);
    if (!bytes) return tl::unexpected(bytes.error());
    const std::string hash = sha256_hex(*bytes);
    // Once more it would make the standard errors smaller, and tell nothing.
    if (const auto same = std::ranges::find(run.used, hash, &MadeFrom::sha256);
        same != run.used.end()) {
      shown.emplace_back(file, static_cast<std::size_t>(same - run.used.begin()));
      passed_over.add(file, "the same picture as " + same->name);
      continue;
    }
    auto corners = find_corners(*image, target);
    if (!corners) {
      if (corners.error().code == ErrorCode::invalid_input) return tl::unexpected(corners.error());
      passed_over.add(file, corners.error().message);
      continue;
    }
    shown.emplace_back(file, views.size());
    run.used.push_back({file.filename().string(), hash});
    views.push_back(std::move(*corners));
  }
  run.skipped = passed_over.lines();
  auto calibration = calibrate_camera(views, width, height);
  if (!calibration) {
    std::string message = calibration.error().message;
    for (const std::string& one : run.skipped) message += "; " + one;
    return fail(calibration.error().code, message);
  }
  // Not before: of a board with another number of columns nothing lies where it is said to.
  if (auto as_given = check_marker(views, target); !as_given)
    return tl::unexpected(as_given.error());
  run.calibration = std::move(*calibration);
  if (run.placed) {
    const auto view = view_of(*board, images, shown);
    if (!view) return tl::unexpected(view.error());
    run.placed->view = *view;
    run.calibration.model.camera_from_world =
        pose_in_rig(run.calibration.views[*view], run.placed->rig_from_target).camera_from_rig;
  }
  if (run.calibration.rms > remarkable_rms)
    run.warnings.push_back(fmt::format(
        "the corners lie {:.2f} px (rms) from where the lens has them, of sharp pictures of the "
        "target described it is less than 0.1 px: is it a checkerboard or a ChArUco board as said "
        "(--target), flat, and of so many squares?",
        run.calibration.rms));
  run.text = camera_calibration_text(run.calibration, target, run.used, utc_now(), run.placed);
  return run;
}

Result<WhiteRun> white_reference_from(const std::filesystem::path& session,
                                      const Eigen::Array3d& reflectance, int threads) {
  const auto record = read_session_folder(session);
  if (!record) return tl::unexpected(record.error());
  const auto prepared = prepare_with_plan(record->rig, record->spec, record->plan);
  if (!prepared) return tl::unexpected(prepared.error());
  Reduction reduction(record->rig, record->spec, *prepared, record->folder, record->darks, threads);
  for (const CapturedShot& shot : record->shots)
    if (auto added = reduction.add(shot); !added) return tl::unexpected(added.error());
  const int channels = record->rig.camera.sensor.channels();
  const std::vector<Mean> means = means_of(reduction, prepared->fit_basis.grid, channels);
  if (auto good = accept(means); !good) return tl::unexpected(good.error());
  WhiteRun run;
  run.white.near = !record->rig.gantry.model.distant_lamp;
  run.white.session = session.lexically_normal().filename().string();
  run.white.reflectance = reflectance;
  for (Eigen::Index c = 0; c < 3; ++c) {
    // A mono camera sees one strength; it stands for all three.
    const Mean& mean = means[std::min(static_cast<std::size_t>(c), means.size() - 1)];
    // f was computed with the strength as written: f / (ρ/π) is how far that is off.
    run.white.strength[c] =
        record->rig.lamp.strength[c] * mean.value() / (reflectance[c] / std::numbers::pi);
    run.white.sigma[c] = mean.scatter() / std::sqrt(static_cast<double>(mean.count));
    run.white.samples += mean.count;
  }
  run.text = white_reference_text(run.white, utc_now());
  return run;
}

}  // namespace lightrig
