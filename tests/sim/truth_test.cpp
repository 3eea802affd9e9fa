#include "sim/truth.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <random>

#include "core/builtin_materials.h"
#include "sim/open_devices.h"
#include "tests/sim/lab_rig.h"

namespace lightrig::sim {
namespace {

constexpr double pi = std::numbers::pi;

Eigen::Array3d smooth(double theta_h, double theta_d, double phi_d) {
  const double lobe = std::exp(-8 * theta_h) * (1.5 + std::cos(2 * phi_d)) + 0.1 * (1 + theta_d);
  return {lobe, 2 * lobe, 0.5 + theta_d};
}

/// The table of `smooth` at cell centres (θh square-root warped).
MerlTable table_of_smooth(int n_h, int n_d, int n_phi) {
  MerlTable table{n_h, n_d, n_phi, {}};
  for (int channel = 0; channel < 3; ++channel) {
    for (int h = 0; h < n_h; ++h) {
      for (int d = 0; d < n_d; ++d) {
        for (int p = 0; p < n_phi; ++p) {
          const double warped = (h + 0.5) / n_h;
          table.f.push_back(smooth(warped * warped * pi / 2, (d + 0.5) / n_d * pi / 2,
                                   (p + 0.5) / n_phi * pi)[channel]);
        }
      }
    }
  }
  return table;
}

TEST(Interpolated, IsTheTableAtItsCellCentresAndNearTheFunctionBetween) {
  const Reflectance f = interpolated(table_of_smooth(90, 90, 180));
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int i = 0; i < 20000; ++i) {
    const double warped = 0.5 / 90 + unit(random) * 89 / 90;
    const HalfDiff a{warped * warped * pi / 2, (0.5 + 89 * unit(random)) / 90 * pi / 2,
                     unit(random) * pi};
    const Eigen::Array3d expected = smooth(a.theta_h, a.theta_d, a.phi_d);
    ASSERT_LT(((f(a) - expected).abs() / expected).maxCoeff(), 2e-3)
        << a.theta_h << " " << a.theta_d << " " << a.phi_d;
  }
  const HalfDiff centre{std::pow(10.5 / 90, 2) * pi / 2, 40.5 / 90 * pi / 2, 77.5 / 180 * pi};
  EXPECT_LT((f(centre) - smooth(centre.theta_h, centre.theta_d, centre.phi_d)).abs().maxCoeff(),
            1e-12);
}

TEST(Interpolated, IsPeriodicInPhiAndHeldAtTheEndsOfTheOtherAngles) {
  const Reflectance f = interpolated(table_of_smooth(20, 20, 36));
  for (const double theta : {0.05, 0.6, 1.4}) {
    EXPECT_LT((f({theta, theta, 1e-9}) - f({theta, theta, pi - 1e-9})).abs().maxCoeff(), 1e-6);
  }
  EXPECT_TRUE(f({0, 0, 0}).allFinite());
  EXPECT_TRUE(f({pi / 2, pi / 2, pi}).allFinite());
  EXPECT_LT((f({0, 0.5, 1}) - f({1e-5, 0.5, 1})).abs().maxCoeff(), 1e-12);  // within half a cell
}

TEST(Interpolated, CellsWithoutAValueAreLeftOutOfTheMeanAndOneSliceIsBivariate) {
  MerlTable table = table_of_smooth(10, 10, 1);
  const Reflectance whole = interpolated(table);
  EXPECT_EQ(whole({0.3, 0.3, 0.2}).matrix(), whole({0.3, 0.3, 2.9}).matrix());
  table.f[5 * 10 + 5] = std::nan("");
  const Reflectance holed = interpolated(table);
  const HalfDiff beside{std::pow(5.9 / 10, 2) * pi / 2, 5.9 / 10 * pi / 2, 1};
  EXPECT_TRUE(holed(beside).allFinite());
  EXPECT_NE(holed(beside)[0], whole(beside)[0]);
  EXPECT_EQ(holed(beside)[1], whole(beside)[1]);
  // Where nothing is known there is no light, not NaN.
  for (double& value : table.f) value = std::nan("");
  EXPECT_TRUE((interpolated(table)(beside) == 0).all());
}

TEST(TruthOf, ABuiltInMaterialIsItself) {
  Rig rig = lab_rig();
  const BuiltinMaterial& material = builtin_materials().front();
  rig.simulation->material = material.name;
  rig.camera.sensor.filter = ColorFilter::bayer_rggb;
  const auto truth = truth_of(rig);
  ASSERT_TRUE(truth) << truth.error().message;
  const HalfDiff a{0.1, 0.5, 1.2};
  EXPECT_EQ((*truth)(a).matrix(), material.reflectance(a).matrix());
  // A mono camera sees the mean of the channels.
  rig.camera.sensor.filter = ColorFilter::mono;
  EXPECT_NEAR((*truth_of(rig))(a)[0], material.reflectance(a).mean(), 1e-15);
}

TEST(TruthOf, AMerlFileIsReadAndAMissingOneIsNamed) {
  Rig rig = lab_rig();
  rig.camera.sensor.filter = ColorFilter::bayer_rggb;
  const auto path = std::filesystem::temp_directory_path() / "lightrig_truth_test.binary";
  const auto bytes = encode_merl(table_of_smooth(12, 12, 6));
  std::ofstream(path, std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes.data()),
             static_cast<std::streamsize>(bytes.size()));
  rig.simulation->material = path.string();
  const auto truth = truth_of(rig);
  ASSERT_TRUE(truth) << truth.error().message;
  const HalfDiff centre{std::pow(3.5 / 12, 2) * pi / 2, 4.5 / 12 * pi / 2, 2.5 / 6 * pi};
  EXPECT_LT(
      ((*truth)(centre)-smooth(centre.theta_h, centre.theta_d, centre.phi_d)).abs().maxCoeff(),
      1e-9);
  std::filesystem::resize_file(path, 1000);
  EXPECT_EQ(truth_of(rig).error().code, ErrorCode::invalid_input);
  std::filesystem::remove(path);
  const auto missing = truth_of(rig);
  EXPECT_EQ(missing.error().code, ErrorCode::not_found);
  EXPECT_NE(missing.error().message.find(path.string()), std::string::npos);
  rig.simulation.reset();
  EXPECT_EQ(truth_of(rig).error().code, ErrorCode::invalid_input);
}

Frame first_frame(const Rig& rig, const ObjectConfig& object, std::uint64_t seed) {
  const auto clock = make_clock(std::numeric_limits<double>::infinity());
  auto world = make_world(rig, object, *clock, seed);
  EXPECT_TRUE(world) << (world ? "" : world.error().message);
  auto devices = open_devices(rig, *world);
  EXPECT_TRUE(devices);
  const auto within = [&] { return Until{clock->now() + std::chrono::minutes(2), {}}; };
  EXPECT_TRUE(devices->gantry->home(within()));
  EXPECT_TRUE(devices->gantry->move_to(dome_position(-1.2, 0.8), within()));
  clock->sleep_until(clock->now() + std::chrono::minutes(1), {});
  EXPECT_TRUE(devices->lamp->set(0.9, within()));
  const auto frame = devices->camera->expose(5.0, within());
  EXPECT_TRUE(frame);
  return *frame;
}

TEST(MakeWorld, OpensTheWholeRigAndPicturesItsObject) {
  Rig rig = lab_rig();
  rig.simulation->material = builtin_materials().front().name;
  ObjectConfig object;
  object.shape = "teapot";
  object.size = 0.1;
  const Frame frame = first_frame(rig, object, 1);
  EXPECT_EQ(frame.counts.counts, first_frame(rig, object, 1).counts.counts);
  EXPECT_NE(frame.counts.counts, first_frame(rig, object, 2).counts.counts);
  // Another pose, position or material is another picture, well beyond the noise.
  const auto squared_difference = [&](const Frame& other) {
    double sum = 0;
    for (std::size_t i = 0; i < frame.counts.counts.size(); ++i) {
      sum += std::pow(double{1} * frame.counts.counts[i] - other.counts.counts[i], 2);
    }
    return sum;
  };
  const double noise = squared_difference(first_frame(rig, object, 2));
  Rig turned = rig;
  turned.simulation->pose_error = 0.2;
  EXPECT_GT(squared_difference(first_frame(turned, object, 1)), 2 * noise);
}

TEST(MakeWorld, AnUnknownMaterialOrAForeignWorldIsRefused) {
  Rig rig = lab_rig();
  rig.simulation->material = "unobtainium";
  ObjectConfig object;
  object.shape = "sphere";
  const auto clock = make_clock(1);
  const auto world = make_world(rig, object, *clock, 1);
  ASSERT_FALSE(world);
  EXPECT_EQ(world.error().code, ErrorCode::not_found);
  EXPECT_NE(world.error().message.find("unobtainium"), std::string::npos);
  rig.simulation->material = builtin_materials().front().name;
  auto good = make_world(rig, object, *clock, 1);
  ASSERT_TRUE(good);
  rig.camera.model.width = 32;
  EXPECT_FALSE(open_devices(rig, *good));
}

}  // namespace
}  // namespace lightrig::sim
