#include "sim/shading.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <numbers>
#include <random>

#include "core/half_diff.h"
#include "core/shapes.h"

namespace lightrig::sim {
namespace {

constexpr double pi = std::numbers::pi;

Reflectance lambert(double albedo) {
  return
      [albedo](const HalfDiff&) -> Eigen::Array3d { return Eigen::Array3d::Constant(albedo / pi); };
}

Eigen::Vector3d on_hemisphere(std::mt19937& random) {
  std::normal_distribution<double> normal;
  Eigen::Vector3d d(normal(random), normal(random), normal(random));
  d.normalize();
  d.z() = std::abs(d.z());
  return d;
}

TEST(AnglesOf, AgreeWithTheAnglesThatExtractionUsesThoughWrittenApart) {
  std::mt19937 random(1);
  for (int i = 0; i < 100000; ++i) {
    const Eigen::Vector3d wi = on_hemisphere(random), wo = on_hemisphere(random);
    const HalfDiff ours = angles_of(Eigen::Vector3d::UnitZ(), wi, wo);
    const HalfDiff core = half_diff(Eigen::Vector3d::UnitZ(), wi, wo);
    ASSERT_NEAR(ours.theta_h, core.theta_h, 1e-12);
    ASSERT_NEAR(ours.theta_d, core.theta_d, 1e-12);
    const double apart = std::abs(ours.phi_d - core.phi_d);
    ASSERT_LT(std::min(apart, pi - apart) * std::sin(ours.theta_h) * std::sin(ours.theta_d), 1e-12);
  }
}

TEST(AnglesOf, AreThoseWorkedByHand) {
  const Eigen::Vector3d n = Eigen::Vector3d::UnitZ();
  const double a = 0.3, b = 0.7;
  // Light and camera in one plane on opposite sides: θh = (b − a)/2, θd = (a + b)/2.
  const HalfDiff plane =
      angles_of(n, {std::sin(a), 0, std::cos(a)}, {-std::sin(b), 0, std::cos(b)});
  EXPECT_NEAR(plane.theta_h, (b - a) / 2, 1e-14);
  EXPECT_NEAR(plane.theta_d, (a + b) / 2, 1e-14);
  EXPECT_NEAR(std::sin(plane.phi_d), 0, 1e-12);  // in the plane of n and h
  // Light and camera mirrored in the plane y = 0: the difference is square to the plane of n and h.
  const Eigen::Vector3d wi = Eigen::Vector3d(0.3, 0.4, 1).normalized();
  const Eigen::Vector3d wo = Eigen::Vector3d(0.3, -0.4, 1).normalized();
  EXPECT_NEAR(angles_of(n, wi, wo).phi_d, pi / 2, 1e-12);
}

TEST(AnglesOf, DoNotChangeWhenLightAndCameraAreExchangedOrTheSceneIsTurned) {
  std::mt19937 random(2);
  for (int i = 0; i < 10000; ++i) {
    const Eigen::Vector3d n = Eigen::Vector3d::UnitZ(), wi = on_hemisphere(random),
                          wo = on_hemisphere(random);
    const Eigen::Matrix3d turn =
        Eigen::AngleAxisd(0.1 * i, on_hemisphere(random)).toRotationMatrix();
    const HalfDiff first = angles_of(n, wi, wo);
    for (const HalfDiff& other :
         {angles_of(n, wo, wi), angles_of(turn * n, turn * wi, turn * wo)}) {
      ASSERT_NEAR(first.theta_h, other.theta_h, 1e-12);
      ASSERT_NEAR(first.theta_d, other.theta_d, 1e-12);
      const double apart = std::abs(first.phi_d - other.phi_d);
      ASSERT_LT(std::min(apart, pi - apart) * first.theta_h * first.theta_d, 1e-11);
    }
  }
}

CameraModel above(int size, double height) {
  CameraModel camera;
  camera.width = camera.height = size;
  camera.fx = camera.fy = 2.0 * size;
  camera.cx = camera.cy = (size - 1) / 2.0;
  camera.camera_from_world = look_at({0, 0, height}, {0, 0, 0}, Eigen::Vector3d::UnitY());
  return camera;
}

RenderOptions options(int strata, int threads) {
  RenderOptions o;
  o.strata = strata;
  o.threads = threads;
  return o;
}

TEST(Render, ALambertPlaneUnderANearLampIsAlbedoOverPiTimesIntensityCosineOverSquare) {
  std::mt19937 random(8);
  std::uniform_real_distribution<double> across(-0.4, 0.4), height(0.05, 2);
  const Mesh plane = make_plane(1, 1, 4);
  for (int trial = 0; trial < 50; ++trial) {
    // A field of view of micrometres: every site sees this one point of the plane.
    const Eigen::Vector3d p(across(random), across(random), 0);
    CameraModel camera = above(3, 1.0);
    camera.fx = camera.fy = 1e7;
    camera.camera_from_world =
        look_at({across(random), across(random), 1}, p, Eigen::Vector3d::UnitY());
    const Renderer renderer(plane, camera, ColorFilter::mono, lambert(0.6), options(1, 1));
    const LightPosition lamp{false, {across(random), across(random), height(random)}};
    const auto image = renderer.render(lamp, Eigen::Array3d::Constant(3.0), {});
    const double r2 = (lamp.p - p).squaredNorm();
    const double expected = 0.6 / pi * 3.0 * (lamp.p.z() / std::sqrt(r2)) / r2;
    EXPECT_NEAR((*image)[4], expected, 2e-5 * expected);
  }
}

TEST(Render, MoreSamplesPerSiteComeNearerToTheSitesMean) {
  const CameraModel camera = above(48, 1.0);
  const LightPosition lamp{false, {0.2, -0.1, 0.5}};
  double worst[2];
  const int strata[2] = {2, 6};
  for (int i = 0; i < 2; ++i) {
    const Renderer renderer(make_plane(1, 1, 4), camera, ColorFilter::mono, lambert(0.6),
                            options(strata[i], 0));
    const auto image = renderer.render(lamp, Eigen::Array3d::Ones(), {});
    worst[i] = 0;
    for (int row = 0; row < 48; ++row) {
      for (int column = 0; column < 48; ++column) {
        const Ray ray = ray_through(camera, column, row);
        const Eigen::Vector3d p = ray.origin - ray.direction * (ray.origin.z() / ray.direction.z());
        const double r2 = (lamp.p - p).squaredNorm();
        const double expected = 0.6 / pi * (0.5 / std::sqrt(r2)) / r2;
        const double got =
            static_cast<double>((*image)[static_cast<std::size_t>(row * 48 + column)]);
        worst[i] = std::max(worst[i], std::abs(got / expected - 1));
      }
    }
  }
  EXPECT_LT(worst[1], 0.3 * worst[0]);  // stratified jitter: error falls as 1/strata², not 1/strata
  EXPECT_LT(worst[1], 0.002);
}

TEST(Render, ASphereUnderADistantLightShowsTheCosineOfItsNormal) {
  CameraModel camera = above(101, 1.0);
  camera.projection = CameraModel::Projection::orthographic;
  camera.fx = camera.fy = 100 / 0.25;
  const Renderer renderer(make_sphere(0.1, 4), camera, ColorFilter::mono, lambert(0.8),
                          options(1, 2));
  const Eigen::Vector3d towards = Eigen::Vector3d(0.4, 0.3, 0.8).normalized();
  const auto image = renderer.render({true, towards}, Eigen::Array3d::Constant(2.0), {});
  int compared = 0;
  for (int row = 0; row < 101; ++row) {
    for (int column = 0; column < 101; ++column) {
      const Ray ray = ray_through(camera, column, row);
      const double d2 = ray.origin.head<2>().squaredNorm();
      const float got = (*image)[static_cast<std::size_t>(row * 101 + column)];
      if (d2 > 0.103 * 0.103) {
        EXPECT_EQ(got, 0.0F);
      } else if (d2 < 0.09 * 0.09) {
        const Eigen::Vector3d n(ray.origin.x() / 0.1, ray.origin.y() / 0.1,
                                std::sqrt(1 - d2 / 0.01));
        const double expected = 0.8 / pi * 2.0 * std::max(0.0, n.dot(towards));
        EXPECT_NEAR(got, expected, 0.02);  // half a site of jitter is 1.25 mm of 100
        ++compared;
      }
    }
  }
  EXPECT_GT(compared, 3000);
}

TEST(Render, CosinePowerLobesOfTheHalfAngleFollowTheirClosedForm) {
  // f = (n + 2)/2π cosⁿ θh on a plane seen from straight above at its centre.
  for (const int power : {1, 10, 100}) {
    const Reflectance lobe = [power](const HalfDiff& a) -> Eigen::Array3d {
      return Eigen::Array3d::Constant((power + 2) / (2 * pi) *
                                      std::pow(std::cos(a.theta_h), power));
    };
    CameraModel camera = above(3, 1000.0);
    camera.fx = camera.fy = 1e7;  // a field of view of micrometres: every site sees the centre
    const Renderer renderer(make_plane(1, 1, 2), camera, ColorFilter::mono, lobe, options(2, 1));
    for (const double tilt : {0.0, 0.2, 0.6, 1.2}) {
      const LightPosition lamp{true, {std::sin(tilt), 0, std::cos(tilt)}};
      const auto image = renderer.render(lamp, Eigen::Array3d::Ones(), {});
      const double expected =
          (power + 2) / (2 * pi) * std::pow(std::cos(tilt / 2), power) * std::cos(tilt);
      EXPECT_NEAR((*image)[4], expected, 1e-5 * expected) << power << " " << tilt;
    }
  }
}

TEST(Render, ALambertSphereGivesBackTheAlbedoOfTheWholeHemisphere) {
  // ∫ f cos θi dω over the lights equals the albedo: 4,000 lights on the hemisphere.
  CameraModel camera = above(3, 1000.0);
  camera.fx = camera.fy = 1e7;
  const Renderer renderer(make_plane(1, 1, 2), camera, ColorFilter::mono, lambert(0.37),
                          options(1, 1));
  double sum = 0;
  const int count = 4000;
  for (int i = 0; i < count; ++i) {
    const double z = (i + 0.5) / count, phi = 2.399963229728653 * i, r = std::sqrt(1 - z * z);
    const auto image = renderer.render({true, {r * std::cos(phi), r * std::sin(phi), z}},
                                       Eigen::Array3d::Ones(), {});
    sum += static_cast<double>((*image)[4]) * 2 * pi / count;
  }
  EXPECT_NEAR(sum, 0.37, 1e-4);
}

TEST(Render, ABallCastsAHardShadowWhereGeometrySaysSo) {
  // A ball of 0.1 m at 0.3 m over a plane, lamp straight above it at 0.9 m: tangents from the lamp
  // give a shadow disc of radius 0.9 tan(asin(0.1/0.6)).
  Mesh scene = make_plane(2, 2, 8);
  const Mesh ball = make_sphere(0.1, 4);
  const Eigen::Index old_vertices = scene.vertices.cols(), old_triangles = scene.triangles.cols();
  scene.vertices.conservativeResize(3, old_vertices + ball.vertices.cols());
  scene.normals.conservativeResize(3, old_vertices + ball.vertices.cols());
  scene.triangles.conservativeResize(3, old_triangles + ball.triangles.cols());
  scene.vertices.rightCols(ball.vertices.cols()) =
      ball.vertices.colwise() + Eigen::Vector3d(0, 0, 0.3);
  scene.normals.rightCols(ball.vertices.cols()) = ball.normals;
  scene.triangles.rightCols(ball.triangles.cols()) =
      ball.triangles.array() + static_cast<int>(old_vertices);
  CameraModel camera = above(201, 1.0);
  camera.projection = CameraModel::Projection::orthographic;
  camera.fx = camera.fy = 200 / 0.8;
  camera.camera_from_world = look_at({0, -1, 1}, {0, 0, 0}, Eigen::Vector3d::UnitZ());
  const Renderer renderer(scene, camera, ColorFilter::mono, lambert(1), options(1, 0));
  const auto image = renderer.render({false, {0, 0, 0.9}}, Eigen::Array3d::Ones(), {});
  const double radius = 0.9 * std::tan(std::asin(0.1 / 0.6));
  int dark = 0, bright = 0;
  for (int row = 0; row < 201; ++row) {
    for (int column = 0; column < 201; ++column) {
      const Ray ray = ray_through(camera, column, row);
      const Eigen::Vector3d to_ball = Eigen::Vector3d(0, 0, 0.3) - ray.origin;
      if (to_ball.cross(ray.direction).norm() < 0.11) continue;  // the ball is in the way
      const Eigen::Vector3d p = ray.origin - ray.direction * (ray.origin.z() / ray.direction.z());
      const double r = p.head<2>().norm();
      const float got = (*image)[static_cast<std::size_t>(row * 201 + column)];
      if (r < radius - 0.006) {
        EXPECT_EQ(got, 0.0F) << p.transpose();
        ++dark;
      } else if (r > radius + 0.006 && p.cwiseAbs().maxCoeff() < 0.9) {
        EXPECT_GT(got, 0.0F) << p.transpose();
        ++bright;
      }
    }
  }
  EXPECT_GT(dark, 500);
  EXPECT_GT(bright, 5000);
}

TEST(Render, SilhouetteSitesAreAveragedNotAliased) {
  // Total flux of a sphere's image converges; with one sample a site is either in or out.
  CameraModel camera = above(41, 1.0);
  camera.projection = CameraModel::Projection::orthographic;
  camera.fx = camera.fy = 40 / 0.25;
  const Reflectance flat = [](const HalfDiff&) -> Eigen::Array3d { return Eigen::Array3d::Ones(); };
  const Renderer renderer(make_sphere(0.1, 4), camera, ColorFilter::mono, flat, options(4, 0));
  const auto image = renderer.render({true, {0, 0, 1}}, Eigen::Array3d::Ones(), {});
  double area = 0;
  for (const float value : *image) area += static_cast<double>(value) / (160.0 * 160.0);
  // ∫ cos θ over the disc = (2/3) π r².
  EXPECT_NEAR(area, 2.0 / 3 * pi * 0.01, 0.003 * 2.0 / 3 * pi * 0.01);
}

TEST(Render, IsTheSameOnOneThreadAndOnMany) {
  const CameraModel camera = above(64, 1.0);
  const Mesh torus = make_torus(0.15, 0.05, 1);
  const Renderer one(torus, camera, ColorFilter::bayer_rggb, lambert(0.5), options(2, 1));
  const Renderer many(torus, camera, ColorFilter::bayer_rggb, lambert(0.5), options(2, 5));
  const LightPosition lamp{false, {0.5, 0.2, 0.3}};
  EXPECT_EQ(*one.render(lamp, Eigen::Array3d(1, 2, 3), {}),
            *many.render(lamp, Eigen::Array3d(1, 2, 3), {}));
}

TEST(Render, AStopRequestEndsIt) {
  const Renderer renderer(make_sphere(0.1, 2), above(64, 1.0), ColorFilter::mono, lambert(0.5),
                          options(2, 1));
  std::stop_source source;
  source.request_stop();
  EXPECT_FALSE(renderer.render({true, {0, 0, 1}}, Eigen::Array3d::Ones(), source.get_token()));
}

}  // namespace
}  // namespace lightrig::sim
