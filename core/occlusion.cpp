#include "core/occlusion.h"

#include <embree3/rtcore.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/check.h"
#include "core/convexity.h"
#include "core/horizon.h"

namespace lightrig {

namespace {

/// How far from the surface a shadow ray starts, and how far from its target it ends, in radii of
/// the mesh's bounding sphere. Far above Embree's float rounding (1e-7), far below any detail that
/// casts a shadow worth a cell.
constexpr double offset_in_radii = 1e-4;

/// The mesh's bounding sphere: Embree sees the mesh moved and scaled into the unit sphere, where
/// its single precision serves every size of object alike.
struct Frame {
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();  ///< [m]
  double radius = 1;                                 ///< [m]

  Eigen::Vector3d to_unit(const Eigen::Vector3d& p) const { return (p - centre) / radius; }
};

Frame bounding_frame(const Mesh& mesh) {
  Frame frame;
  if (mesh.vertices.cols() == 0) return frame;
  frame.centre = 0.5 * (mesh.vertices.rowwise().minCoeff() + mesh.vertices.rowwise().maxCoeff());
  const double radius =
      std::sqrt((mesh.vertices.colwise() - frame.centre).colwise().squaredNorm().maxCoeff());
  if (radius > 0) frame.radius = radius;
  return frame;
}

/// A shadow ray in unit coordinates, moved to where it enters the unit sphere.
struct UnitRay {
  Eigen::Vector3d origin, direction;
  double skipped = 0;  ///< length left out before the origin
  double length = 0;   ///< to the far end
};

/// Radius of a sphere a little larger than the unit sphere.
constexpr double reach = 1.01;

/// The part of a ray inside that sphere; empty where they do not
/// meet. Starting there keeps single precision even for a camera a thousand radii away.
std::optional<UnitRay> clip(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                            double length) {
  const double b = origin.dot(direction);
  const Eigen::Vector3d nearest = origin - b * direction;
  const double half2 = reach * reach - nearest.squaredNorm();
  if (!(half2 > 0)) return std::nullopt;
  const double half = std::sqrt(half2);
  const double enter = std::max(0.0, -b - half);
  const double leave = std::min(length, -b + half);
  if (!(leave > enter)) return std::nullopt;
  return UnitRay{origin + enter * direction, direction, enter, leave - enter};
}

RTCRay embree_ray(const UnitRay& ray) {
  const Eigen::Vector3f origin = ray.origin.cast<float>();
  const Eigen::Vector3f direction = ray.direction.cast<float>();
  return {origin.x(),
          origin.y(),
          origin.z(),
          0.0F,
          direction.x(),
          direction.y(),
          direction.z(),
          0.0F,
          static_cast<float>(ray.length),
          ~0U,
          0U,
          0U};
}

/// Barycentric coordinates (u, v) of where a ray meets a triangle's plane and the distance to it,
/// in double precision, kept inside the triangle.
Hit refined_hit(const Mesh& mesh, int triangle, const Ray& ray, double fallback_distance) {
  const Eigen::Vector3d a = mesh.vertices.col(mesh.triangles(0, triangle));
  const Eigen::Vector3d ab = mesh.vertices.col(mesh.triangles(1, triangle)) - a;
  const Eigen::Vector3d ac = mesh.vertices.col(mesh.triangles(2, triangle)) - a;
  const Eigen::Vector3d p = ray.direction.cross(ac);
  const double determinant = ab.dot(p);
  Hit hit{fallback_distance, triangle, 1.0 / 3, 1.0 / 3};
  if (determinant == 0.0) return hit;
  const Eigen::Vector3d from_a = ray.origin - a;
  const Eigen::Vector3d q = from_a.cross(ab);
  const double distance = ac.dot(q) / determinant;
  if (!std::isfinite(distance)) return hit;
  hit.distance = distance;
  hit.u = std::clamp(from_a.dot(p) / determinant, 0.0, 1.0);
  hit.v = std::clamp(ray.direction.dot(q) / determinant, 0.0, 1.0 - hit.u);
  return hit;
}

}  // namespace

struct Occluder::Scene {
  Mesh mesh;
  Frame frame;
  bool convex = false;
  NormalTilt tilt;  ///< where convex
  HorizonTree horizon;
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;

  Scene() = default;
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;
  ~Scene() {
    if (scene != nullptr) rtcReleaseScene(scene);
    if (device != nullptr) rtcReleaseDevice(device);
  }

  /// The shadow ray of a surface point; empty where nothing can lie in its way.
  std::optional<UnitRay> shadow_ray(const Eigen::Vector3d& point, const Eigen::Vector3d& normal,
                                    const LightPosition& light) const {
    const Eigen::Vector3d start = frame.to_unit(point) + offset_in_radii * normal;
    if (light.distant) {
      // Within the sphere, where surface points are, a ray of its diameter leaves it on any way.
      if (start.squaredNorm() <= reach * reach) return UnitRay{start, light.p, 0, 2 * reach};
      return clip(start, light.p, std::numeric_limits<double>::max());
    }
    const Eigen::Vector3d way = frame.to_unit(light.p) - start;
    const double length = way.norm();
    if (!(length > 0)) return std::nullopt;
    return clip(start, way / length, length);
  }
};

Occluder::Occluder(const Mesh& mesh) : scene_(std::make_unique<Scene>()) {
  scene_->mesh = mesh;
  scene_->frame = bounding_frame(mesh);
  scene_->convex = is_closed_and_convex(mesh, scene_->frame.radius);
  if (scene_->convex) {
    scene_->tilt = tilt_of_normals(mesh);
  } else {
    const Eigen::Matrix3Xd unit =
        (mesh.vertices.colwise() - scene_->frame.centre) / scene_->frame.radius;
    scene_->horizon = HorizonTree(unit, mesh.triangles);
  }
  // Embree's own worker threads only build the tree; one is enough, and leaves nothing running.
  scene_->device = rtcNewDevice("threads=1,set_affinity=0");
  CHECK(scene_->device != nullptr);
  scene_->scene = rtcNewScene(scene_->device);
  rtcSetSceneFlags(scene_->scene, RTC_SCENE_FLAG_ROBUST);
  if (mesh.triangles.cols() > 0) {
    RTCGeometry geometry = rtcNewGeometry(scene_->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* vertex = static_cast<float*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                3 * sizeof(float), static_cast<std::size_t>(mesh.vertices.cols())));
    auto* index = static_cast<unsigned*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(unsigned),
        static_cast<std::size_t>(mesh.triangles.cols())));
    CHECK(vertex != nullptr && index != nullptr);
    for (Eigen::Index v = 0; v < mesh.vertices.cols(); ++v) {
      const Eigen::Vector3f p = scene_->frame.to_unit(mesh.vertices.col(v)).cast<float>();
      std::copy_n(p.data(), 3, vertex + 3 * v);
    }
    std::transform(mesh.triangles.data(), mesh.triangles.data() + mesh.triangles.size(), index,
                   [](int i) { return static_cast<unsigned>(i); });
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene_->scene, geometry);
    rtcReleaseGeometry(geometry);
  }
  rtcCommitScene(scene_->scene);
}

Occluder::~Occluder() = default;
Occluder::Occluder(Occluder&&) noexcept = default;
Occluder& Occluder::operator=(Occluder&&) noexcept = default;

std::optional<Hit> Occluder::first_hit(const Ray& ray) const {
  const std::optional<UnitRay> unit =
      clip(scene_->frame.to_unit(ray.origin), ray.direction, std::numeric_limits<double>::max());
  if (!unit) return std::nullopt;
  RTCRayHit query{};
  query.ray = embree_ray(*unit);
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(scene_->scene, &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;
  return refined_hit(scene_->mesh, static_cast<int>(query.hit.primID), ray,
                     (unit->skipped + double{query.ray.tfar}) * scene_->frame.radius);
}

bool Occluder::blocked(const Eigen::Vector3d& point, const Eigen::Vector3d& normal,
                       const LightPosition& light) const {
  std::uint8_t out = 0;
  blocked({&point, 1}, {&normal, 1}, light, {&out, 1});
  return out != 0;
}

void Occluder::blocked(std::span<const Eigen::Vector3d> points,
                       std::span<const Eigen::Vector3d> normals, const LightPosition& light,
                       std::span<std::uint8_t> out) const {
  CHECK(points.size() == normals.size() && points.size() == out.size());
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags =
      light.distant ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  // One ray at a time: points that fill different cells lie all over the object, and packets of
  // eight or sixteen such rays take longer than single ones [docs/planning.md].
  for (std::size_t i = 0; i < points.size(); ++i) {
    out[i] = 0;
    const std::optional<UnitRay> unit = scene_->shadow_ray(points[i], normals[i], light);
    if (!unit) continue;
    RTCRay ray = embree_ray(*unit);
    rtcOccluded1(scene_->scene, &context, &ray);
    if (ray.tfar < 0.0F) out[i] = 1;  // Embree's mark of a blocked ray: −∞
  }
}

double Occluder::horizon(const Eigen::Vector3d& point, const Eigen::Vector3d& normal) const {
  if (scene_->convex) return sure_cosine(false);
  const Eigen::Vector3d start = scene_->frame.to_unit(point) + offset_in_radii * normal;
  // Embree's single precision moves what is as near as the start's own offset by 6e-4 of its slope,
  // and the start itself by 1e-7.
  return 1.002 * scene_->horizon.sine(start - 1e-6 * normal, normal) + 1e-5;
}

double Occluder::sure_cosine(bool at_vertices) const {
  constexpr double never = 2;
  if (!scene_->convex) return never;
  const double tilt = at_vertices ? scene_->tilt.at_vertices : scene_->tilt.on_faces;
  // A start that is hardly above its face may be below it in single precision.
  if (tilt > 0.99) return never;
  return tilt > 0 ? 1.0001 * tilt + 1e-6 : 0.0;
}

bool Occluder::convex() const { return scene_->convex; }

}  // namespace lightrig
