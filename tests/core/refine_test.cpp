#include "core/refine.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "core/azimuth_model.h"
#include "core/pixel_neighbours.h"
#include "core/shapes.h"

namespace lightrig {
namespace {

constexpr double slope = 0.8;  // of ln f per cell of θh

/// A basis whose mean is ln f = −slope · (row + ½) and whose one component is constant.
BrdfBasis slanted_basis() {
  BrdfBasis basis;
  basis.grid = {6, 6};
  basis.channels = 1;
  basis.valid.assign(36, 1);
  basis.mean.resize(36);
  for (int cell = 0; cell < 36; ++cell) basis.mean[cell] = -slope * (basis.grid.row_h(cell) + 0.5);
  basis.V = Eigen::MatrixXd::Constant(36, 1, 1.0 / 6);
  basis.stddev = basis.training_stddev = Eigen::VectorXd::Constant(1, 3.0);
  basis.y_min = Eigen::VectorXd::Constant(36, -20);
  basis.y_max = Eigen::VectorXd::Constant(36, 20);
  return basis;
}

Coefficients no_coefficients() {
  Coefficients c;
  c.c = Eigen::MatrixXd::Zero(1, 1);
  c.covariance = {Eigen::MatrixXd::Identity(1, 1)};
  return c;
}

/// One row of cell (2, 3) seen through one footprint at these θh.
BrdfObservations seen_at(const BrdfBasis& basis, double f, const std::array<float, 4>& h) {
  BrdfObservations light;
  light.rows.push_back(
      {basis.grid.cell(2, 3), 0, BrdfObservation::Kind::value, 1, f, 1e-6 * f * f});
  Footprint footprint;
  footprint.weight = 2;
  footprint.h = h;
  footprint.d = {3.5F, 3.5F, 3.5F, 3.5F};
  light.footprints.push_back(footprint);
  return light;
}

TEST(Refined, BringsAnOffCentreMeasurementToTheCellsCentre) {
  const BrdfBasis basis = slanted_basis();
  const double measured = std::exp(-slope * 2.9);
  const BrdfObservations light = seen_at(basis, measured, {2.9F, 2.9F, 2.9F, 2.9F});
  const BrdfObservation row = refined(light, basis, {}, no_coefficients()).rows[0];
  EXPECT_NEAR(row.f, std::exp(-slope * 2.5), 1e-6);
  // 0.3 of the shift of 0.4 cells is doubted.
  EXPECT_NEAR(std::sqrt(row.variance) / row.f, std::hypot(1e-3, 0.3 * 0.4 * slope), 1e-6);
}

TEST(Refined, TakesTheBlurOfAWideFootprintOut) {
  const BrdfBasis basis = slanted_basis();
  double mean = 0;
  for (const double h : {1.5, 2.0, 3.0, 3.5}) mean += std::exp(-slope * h) / 4;
  const BrdfObservations light = seen_at(basis, mean, {1.5F, 2.0F, 3.0F, 3.5F});
  EXPECT_NEAR(refined(light, basis, {}, no_coefficients()).rows[0].f, std::exp(-slope * 2.5), 1e-6);
}

TEST(Refined, LeavesBoundsAndRowsWithoutFootprintsAlone) {
  const BrdfBasis basis = slanted_basis();
  BrdfObservations light = seen_at(basis, 0.2, {2.9F, 2.9F, 2.9F, 2.9F});
  light.rows.push_back({basis.grid.cell(4, 1), 0, BrdfObservation::Kind::below, 3, 0.01, 0});
  light.rows.push_back({basis.grid.cell(5, 1), 0, BrdfObservation::Kind::value, 3, 0.03, 1e-6});
  const BrdfObservations out = refined(light, basis, {}, no_coefficients());
  EXPECT_EQ(out.rows[1].f, 0.01);
  EXPECT_EQ(out.rows[2].f, 0.03);
  EXPECT_EQ(out.rows[2].variance, 1e-6);
}

TEST(FitRefined, RecoversAMaterialThatBlurHides) {
  const BrdfBasis basis = slanted_basis();
  // The truth is the mean times e^0.7: coefficient 0.7 · 6. Every row is seen 0.45 cells low.
  BrdfObservations light;
  for (int i = 0; i < 5; ++i) {
    const double f = std::exp(0.7 - slope * (i + 0.95));
    light.rows.push_back({basis.grid.cell(i, 2), 0, BrdfObservation::Kind::value, 1, f, 0});
    const auto h = static_cast<float>(i + 0.95);
    Footprint footprint;
    footprint.row = i;
    footprint.weight = 1;
    footprint.h = {h, h, h, h};
    footprint.d = {2.5F, 2.5F, 2.5F, 2.5F};
    light.footprints.push_back(footprint);
  }
  FitOptions options;
  options.model_sigma = 0.01;
  const double plain = fit_adaptive(basis, {&light, 1}, 1, options).coefficients.c(0, 0);
  const double better = fit_refined(basis, {}, {&light, 1}, 1, options).coefficients.c(0, 0);
  EXPECT_GT(std::abs(plain - 4.2), 1.5);
  EXPECT_NEAR(better, 4.2, 0.05);
}

TEST(AzimuthDepartures, OfAMerlTableAreMeansOverEqualPartsOfItsRange) {
  MerlTable table{2, 2, 720, std::vector<double>(3 * 4 * 720)};
  for (std::size_t i = 0; i < table.f.size(); ++i) {
    const double phi = (static_cast<double>(i % 720) + 0.5) * std::numbers::pi / 720;
    table.f[i] = 1 + std::cos(phi) * std::cos(phi);
  }
  const Eigen::ArrayXXf departures = azimuth_departures(table);
  ASSERT_EQ(departures.rows(), 4 * azimuth_bins);
  // Cell (0, 0): every φd is above the horizon. Mean of 1 + cos² over [a, b] and over [0, π/2].
  for (int bin = 0; bin < azimuth_bins; ++bin) {
    const double a = bin * std::numbers::pi / 8, b = a + std::numbers::pi / 8;
    const double mean = 1.5 + (std::sin(2 * b) - std::sin(2 * a)) / (4 * (b - a));
    EXPECT_NEAR(double{departures(bin, 0)}, std::log(mean / 1.5), 2e-3);
  }
  table.n_phi = 1;
  EXPECT_EQ(azimuth_departures(table).size(), 0);
}

TEST(AzimuthModel, SaysHowFRunsWithAzimuthForAMaterialItHasNotSeen) {
  // ln f = strength · (1 + row) and its departure at part b of φd is 0.1 · strength · (b − 1.5).
  const BivariateGrid grid{8, 8};
  const auto material = [&](double strength) {
    Material m{"m", "", "", {grid, Eigen::ArrayXXd(64, 1)}, {}};
    m.azimuth.resize(64 * azimuth_bins, 1);
    for (int cell = 0; cell < 64; ++cell) {
      m.table.f(cell, 0) = std::exp(strength * (1 + grid.row_h(cell)) / 8.0);
      for (int b = 0; b < azimuth_bins; ++b) {
        m.azimuth(cell * azimuth_bins + b, 0) = static_cast<float>(0.1 * strength * (b - 1.5));
      }
    }
    return m;
  };
  std::vector<Material> materials;
  for (const double s : {-3.0, -1.0, 0.5, 1.5, 2.0}) materials.push_back(material(s));
  BasisOptions options;
  options.components = 1;
  options.sigma_folds = 0;
  options.floor = 1e-9;
  const BrdfBasis basis = make_basis(materials, options).value();
  const AzimuthModel model(materials, basis);
  ASSERT_FALSE(model.none());
  const Material unseen = material(1.0);
  Eigen::VectorXd y(64);
  for (int cell = 0; cell < 64; ++cell) y[cell] = std::log(unseen.table.f(cell, 0));
  const Eigen::MatrixXd c = basis.V.transpose() * (y - basis.mean);
  for (int b = 0; b < azimuth_bins; ++b) {
    const double share = (b + 0.5) / azimuth_bins;
    const double said = double{model.departure(20, share, model.weights(c))[0]};
    EXPECT_NEAR(said, 0.1 * (b - 1.5), 0.003) << b;
    const std::pair<int, double> place{20, share};
    EXPECT_LT(model.variance({&place, 1})[0], 1e-4);
  }
  materials[2].azimuth.resize(0, 0);
  EXPECT_TRUE(AzimuthModel(materials, basis).none());
}

TEST(AzimuthShare, RunsFromTheHorizonToTheMiddleAndFoldsThere) {
  EXPECT_NEAR(azimuth_share({0.5, 0.5, 0}), 0, 1e-12);
  EXPECT_NEAR(azimuth_share({0.5, 0.5, std::numbers::pi / 2}), 1, 1e-12);
  EXPECT_NEAR(azimuth_share({0.5, 0.5, 0.4}), azimuth_share({0.5, 0.5, std::numbers::pi - 0.4}),
              1e-12);
  // tan 60° · tan 60° = 3: the horizon is at φd = acos(1/3).
  const double first = std::acos(1.0 / 3);
  EXPECT_NEAR(azimuth_share({std::numbers::pi / 3, std::numbers::pi / 3, first}), 0, 1e-9);
  EXPECT_NEAR(azimuth_share(
                  {std::numbers::pi / 3, std::numbers::pi / 3, (first + std::numbers::pi / 2) / 2}),
              0.5, 1e-9);
}

TEST(PixelNeighbours, OfABallAreWholeInTheMiddleAndNotAtItsRim) {
  const Mesh ball = make_sphere(1.0, 3);
  const Occluder occluder(ball);
  CameraModel camera;
  camera.projection = CameraModel::Projection::orthographic;
  camera.width = camera.height = 101;
  camera.fx = camera.fy = 90;  // [px/m]: the radius is as many pixels as half the diameter
  camera.cx = camera.cy = 50;
  camera.camera_from_world = look_at({0, 0, 5}, {0, 0, 0}, {0, 1, 0});
  const SurfacePoints points = points_of_pixels(ball, occluder, camera, 1);
  const PixelNeighbours neighbours(points, 101, 101);
  const double radius = points.position.colwise().norm().maxCoeff();
  Eigen::Index inside = 0, outermost = 0;
  double farthest = 0;
  for (Eigen::Index i = 0; i < points.size(); ++i) {
    const double out = points.position.col(i).head<2>().norm() / radius;
    if (out > farthest) {
      farthest = out;
      outermost = i;
    }
    if (out > 0.5) continue;
    ++inside;
    ASSERT_TRUE(neighbours.whole(i)) << out;
    // One pixel along a column of the picture is 1/90 m, hence the turn of a ball's normal.
    const PixelNeighbours::Slopes across = neighbours.slopes(i);
    EXPECT_NEAR(across.position_u.head<2>().norm(), 1.0 / 90, 1e-4);
    EXPECT_NEAR(across.normal_u.head<2>().norm(), 1.0 / 90 / radius, 0.002);
  }
  EXPECT_GT(inside, 500);
  // What lies one pixel further out is not the ball.
  EXPECT_FALSE(neighbours.whole(outermost));
  EXPECT_LT(neighbours.whole_points().size(), points.size());
}

}  // namespace
}  // namespace lightrig
