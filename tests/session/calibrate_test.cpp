// From pictures of a board in a folder to a rig file that knows where its camera stands.
#include "daemon/session/calibrate.h"

#include <OpenImageIO/imageio.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <random>

#include "config/read_rig.h"
#include "core/sensor.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/frame_file.h"
#include "daemon/session/picture_file.h"
#include "tests/core/target_scene.h"
#include "tests/paths.h"
#include "tests/session/scratch.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

CalibrationTarget board() {
  CalibrationTarget target;
  target.columns = 7;
  target.rows = 5;
  target.square = 0.03;
  target.marker = 0.022;
  return target;
}

CameraModel true_camera() {
  CameraModel camera;
  camera.width = 480;
  camera.height = 360;
  camera.fx = 610;
  camera.fy = 608;
  camera.cx = 241;
  camera.cy = 178;
  camera.distortion = {-0.12, 0.03, 0, 0, 0};
  return camera;
}

/// The board lies on the table, its upper left corner at (−0.1, 0.07, 0.002), its upper edge along
/// +x, its left edge along −y: face up.
BoardPlace as_it_lay(fs::path image = {}) {
  return {std::move(image), {-0.1, 0.07, 0.002}, {1, 0, 0}, {0, -1, 0}};
}

/// Pictures of a board in a folder: first.png with nothing in it, then seven of the board.
class Pictures : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = std::make_unique<Scratch>();
    store("first.png", {480, 360, std::vector<std::uint8_t>(std::size_t{480} * 360, 90)});
    poses_ = render("view", 7, 8);
  }
  static std::vector<Eigen::Isometry3d> render(const std::string& name, int count, unsigned seed) {
    const CameraModel camera = true_camera();
    constexpr int pixels_per_square = 160;
    const GreyImage texture = target_image(board(), pixels_per_square).value();
    const test::Sights sights(camera);
    std::mt19937_64 random(seed);
    test::TargetPicture how;
    how.noise = 1;
    const auto poses = test::drawn_views(camera, board(), count, true, random);
    for (std::size_t i = 0; i < poses.size(); ++i)
      store(name + std::to_string(i) + ".png",
            test::picture_of_target(sights, poses[i], texture, board(), pixels_per_square, how,
                                    random));
    return poses;
  }
  static void TearDownTestSuite() { folder_.reset(); }

  static void store(const std::string& name, const GreyImage& image) {
    const auto png = encode_png(image.width, image.height, 1, image.pixels);
    ASSERT_TRUE(png && write_durably(folder_->path() / name, *png));
    files_.push_back(folder_->path() / name);
  }
  /// Those of the board alone.
  static std::vector<fs::path> good() { return {files_.begin() + 1, files_.end()}; }

  static inline std::unique_ptr<Scratch> folder_;
  static inline std::vector<fs::path> files_;
  static inline std::vector<Eigen::Isometry3d> poses_;
};

TEST_F(Pictures, OfAPlacedBoardTellARigFileWhereItsCameraStands) {
  const auto run = calibrate_camera_from(good(), board(), as_it_lay(files_[3]));
  ASSERT_TRUE(run) << run.error().message;
  EXPECT_TRUE(run->skipped.empty());
  EXPECT_EQ(run->placed->view, 2U);
  const fs::path sealed = folder_->path() / "camera.json";
  ASSERT_TRUE(write_durably(sealed, run->text));

  std::ifstream in(fs::path(test::source_dir) / "config/rigs/dome_mono.toml");
  std::string text{std::istreambuf_iterator<char>(in), {}};
  const auto line = [&](const std::string& key, const std::string& instead) {
    const auto at = text.find("\n" + key + " =");
    if (at != std::string::npos) text.replace(at + 1, text.find('\n', at + 1) - at - 1, instead);
  };
  line("fx_px", "calibration = \"" + sealed.string() + "\"");
  for (const char* key : {"fy_px", "cx_px", "cy_px", "eye_m", "target_m", "up"}) line(key, "");
  line("width_px", "width_px = 480");
  line("height_px", "height_px = 360");
  const auto rig =
      read_rig_text(text, fs::path(test::source_dir) / "config/rigs/dome_calibrated.toml");
  ASSERT_TRUE(rig.value) << to_text(rig.diagnostics);

  const CalibrationMark& mark = rig.value->camera.calibration_mark;
  EXPECT_EQ(mark.sha256, nlohmann::json::parse(run->text).at("sha256"));
  EXPECT_EQ(mark.sigma, run->calibration.sigma[0]);
  EXPECT_FALSE(mark.date.empty());

  // What the pictures were rendered from, and where the board was said to lie.
  Eigen::Isometry3d rig_from_target = Eigen::Isometry3d::Identity();
  rig_from_target.linear() << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  rig_from_target.translation() << -0.1, 0.07, 0.002;
  const Eigen::Isometry3d truth = rig_from_target * poses_[2].inverse();
  const Eigen::Isometry3d stands = rig.value->camera.model.camera_from_world.inverse();
  const auto in_rig = nlohmann::json::parse(run->text).at("in_rig");
  EXPECT_EQ(in_rig.at("image"), "view2.png");
  for (Eigen::Index i = 0; i < 3; ++i) {
    const double sigma =
        in_rig.at("standard_errors").at("eye_m").at(static_cast<std::size_t>(i)).get<double>();
    EXPECT_GT(sigma, 1e-6);
    EXPECT_LT(sigma, 3e-3);
    EXPECT_LT(std::abs(stands.translation()[i] - truth.translation()[i]), 4 * sigma) << i;
  }
  EXPECT_GT(stands.translation().z(), 0) << "above the table that the board lies on, face up";
  EXPECT_LT(Eigen::AngleAxisd(stands.linear() * truth.linear().transpose()).angle(), 0.01);
}

TEST_F(Pictures, WithoutTheBoardArePassedOverAndSaidUnlessTheBoardWasMeasuredInThem) {
  const auto run = calibrate_camera_from(files_, board());
  ASSERT_TRUE(run) << run.error().message;
  EXPECT_THAT(run->skipped, testing::ElementsAre(HasSubstr("first.png")));
  EXPECT_EQ(run->used.size(), 7U);
  EXPECT_FALSE(nlohmann::json::parse(run->text).contains("in_rig"));
  // The place was measured for the first picture, which shows nothing: no other may stand in.
  const auto first = calibrate_camera_from(files_, board(), as_it_lay());
  ASSERT_FALSE(first);
  EXPECT_THAT(first.error().message,
              testing::AllOf(HasSubstr("first.png"), HasSubstr("in which it was not found")));
  const auto named = calibrate_camera_from(files_, board(), as_it_lay(files_[1]));
  ASSERT_TRUE(named) << named.error().message;
  EXPECT_EQ(named->placed->view, 0U);
}

TEST_F(Pictures, AWrongBoardImageIsRefused) {
  const auto run = calibrate_camera_from(good(), board(), as_it_lay("elsewhere.png"));
  ASSERT_FALSE(run);
  EXPECT_THAT(run.error().message,
              testing::AllOf(HasSubstr("elsewhere.png"), HasSubstr("none of the pictures")));
}

TEST_F(Pictures, ACheckerboardCannotBePlaced) {
  CalibrationTarget checkerboard = board();
  checkerboard.kind = CalibrationTarget::Kind::checkerboard;
  const auto run = calibrate_camera_from(good(), checkerboard, as_it_lay());
  ASSERT_FALSE(run);
  EXPECT_THAT(run.error().message, HasSubstr("looks alike from both of its ends"));
}

/// What a camera of 12 bits makes of a pixel.
std::uint16_t counts_of(std::uint8_t grey, double filter = 1) {
  return static_cast<std::uint16_t>(std::lround(40 + filter * 9 * grey));
}

TEST_F(Pictures, OfTwelveBitsInSixteenAreSpreadOverTheGreys) {
  std::vector<fs::path> deep;
  for (const fs::path& file : good()) {
    const GreyImage grey = read_grey_image(file).value();
    std::vector<std::uint16_t> counts;
    for (const std::uint8_t value : grey.pixels) counts.push_back(counts_of(value));
    deep.push_back(folder_->path() / ("deep_" + file.filename().string()));
    const auto out = OIIO::ImageOutput::create("png");
    ASSERT_TRUE(out && out->open(deep.back().string(), OIIO::ImageSpec(grey.width, grey.height, 1,
                                                                       OIIO::TypeDesc::UINT16)));
    ASSERT_TRUE(out->write_image(OIIO::TypeDesc::UINT16, counts.data()) && out->close());
  }
  const auto run = calibrate_camera_from(deep, board());
  ASSERT_TRUE(run) << run.error().message;
  EXPECT_EQ(run->used.size(), good().size());
  EXPECT_LT(std::abs(run->calibration.model.fx - true_camera().fx), 4 * run->calibration.sigma[0]);
}

TEST_F(Pictures, OfASessionServeToCalibrateThoughTheSensorHasAMosaic) {
  SensorModel sensor;
  sensor.filter = ColorFilter::bayer_rggb;
  sensor.bits = 12;
  std::vector<fs::path> stored;
  for (const fs::path& file : good()) {
    const GreyImage grey = read_grey_image(file).value();
    Frame frame;
    frame.exposure = 0.01;
    frame.counts.width = grey.width;
    frame.counts.height = grey.height;
    for (int y = 0; y < grey.height; ++y)
      for (int x = 0; x < grey.width; ++x) {
        const double filters[] = {0.5, 1, 1, 0.3};  // red, green, green, blue
        const auto at = static_cast<std::size_t>(y) * static_cast<std::size_t>(grey.width) +
                        static_cast<std::size_t>(x);
        frame.counts.counts.push_back(counts_of(grey.pixels[at], filters[y % 2 * 2 + x % 2]));
      }
    const auto bytes = encode_frame(frame, sensor);
    ASSERT_TRUE(bytes);
    stored.push_back(folder_->path() / (file.stem().string() + ".exr"));
    ASSERT_TRUE(write_durably(stored.back(), *bytes));
  }
  const auto run = calibrate_camera_from(stored, board());
  ASSERT_TRUE(run) << run.error().message;
  EXPECT_EQ(run->used.size(), good().size());
  EXPECT_LT(run->calibration.rms, 0.15) << "as of the pictures without a mosaic";
}

TEST_F(Pictures, ThatShowNothingAreRefusedWithOneSentenceForAllOfThem) {
  std::vector<fs::path> empty;
  for (const char* name : {"a.png", "b.png", "c.png", "d.png", "e.png"}) {
    const auto png = encode_png(480, 360, 1, std::vector<std::uint8_t>(std::size_t{480} * 360, 90));
    empty.push_back(folder_->path() / name);
    ASSERT_TRUE(png && write_durably(empty.back(), *png));
  }
  const auto run = calibrate_camera_from(empty, board());
  ASSERT_FALSE(run);
  const std::string& message = run.error().message;
  EXPECT_THAT(message, HasSubstr("; 5 images (a.png … e.png): 0 markers"));
  EXPECT_EQ(message.find("0 markers"), message.rfind("0 markers")) << message;
}

TEST_F(Pictures, OfAPrintOfAnotherSizeAreRefusedByItsMarkers) {
  CalibrationTarget larger = board();
  larger.square *= 1.25;  // and the marker as measured
  const auto run = calibrate_camera_from(good(), larger);
  ASSERT_FALSE(run);
  EXPECT_THAT(run.error().message,
              testing::AllOf(HasSubstr("the markers' edges are 0.7"), HasSubstr("--marker-mm")));
  larger.square = 1.02 * board().square;
  EXPECT_TRUE(calibrate_camera_from(good(), larger)) << "a print measured badly is still that one";
}

TEST_F(Pictures, OfABoardOfOtherColumnsAreRefusedForThat) {
  CalibrationTarget narrow = board();
  narrow.columns = 6;
  const auto run = calibrate_camera_from(good(), narrow);
  ASSERT_FALSE(run);
  EXPECT_THAT(run.error().message,
              testing::AllOf(HasSubstr("px (rms)"), HasSubstr("--columns, --rows")));
}

TEST_F(Pictures, GivenTwiceCountOnce) {
  const auto once = calibrate_camera_from(good(), board());
  ASSERT_TRUE(once) << once.error().message;
  std::vector<fs::path> twice = good();
  twice.push_back(folder_->path() / "copy.png");
  fs::copy_file(good()[2], twice.back(), fs::copy_options::overwrite_existing);
  const auto run = calibrate_camera_from(twice, board(), as_it_lay(twice.back()));
  ASSERT_TRUE(run) << run.error().message;
  EXPECT_THAT(run->skipped, testing::ElementsAre("copy.png: the same picture as view2.png"));
  EXPECT_EQ(run->calibration.sigma, once->calibration.sigma);
  EXPECT_EQ(run->placed->view, 2U) << "a board measured in the copy was measured in the picture";
}

TEST_F(Pictures, TakenForThoseOfAnotherKindOfTargetAreAcceptedWithAWarning) {
  CalibrationTarget checkerboard = board();
  checkerboard.kind = CalibrationTarget::Kind::checkerboard;
  std::vector<fs::path> many = good();
  const auto before = static_cast<std::ptrdiff_t>(files_.size());
  render("more", 12, 9);
  many.insert(many.end(), files_.begin() + before, files_.end());
  files_.erase(files_.begin() + before, files_.end());
  const auto run = calibrate_camera_from(many, checkerboard);
  ASSERT_TRUE(run) << run.error().message;
  EXPECT_THAT(run->warnings, testing::ElementsAre(HasSubstr("--target")));
  EXPECT_TRUE(calibrate_camera_from(good(), board())->warnings.empty());
}

}  // namespace
}  // namespace lightrig
