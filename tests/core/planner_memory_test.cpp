// No memory is taken per candidate, nor per point: what planning allocates does not grow with them.

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <new>

#include "core/planner.h"
#include "core/surface_points.h"
#include "planner_scene.h"

namespace {

std::atomic<std::int64_t> allocations{0};

}  // namespace

// The whole test program counts: every malloc, Eigen's among them, or, where a sanitizer may have
// one of its own, every new.
#if defined(__GLIBC__) && !defined(__clang__) && !defined(__SANITIZE_ADDRESS__) && \
    !defined(__SANITIZE_THREAD__)

extern "C" {
void* __libc_malloc(std::size_t size);  // NOLINT(bugprone-reserved-identifier): glibc's name
void* malloc(std::size_t size) {
  ++allocations;
  return __libc_malloc(size);
}
}

#else

namespace {

void* counted(std::size_t size) {
  ++allocations;
  if (void* memory = std::malloc(size > 0 ? size : 1); memory != nullptr) return memory;
  throw std::bad_alloc();
}

}  // namespace

void* operator new(std::size_t size) { return counted(size); }
void* operator new[](std::size_t size) { return counted(size); }
// As std::stable_sort asks for its buffer.
void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
  ++allocations;
  return std::malloc(size == 0 ? 1 : size);
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete[](void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }
void operator delete[](void* memory, std::size_t) noexcept { std::free(memory); }

#endif

namespace lightrig {
namespace {

TEST(PlannerMemory, SelectionAllocatesNothingPerCandidate) {
  const BivariateGrid grid{40, 12};
  const BrdfBasis basis = test::random_basis(3, grid, ChannelLayout::columns, 1, 24, 0.8);
  for (const Criterion criterion : {Criterion::condition, Criterion::a_optimal}) {
    std::int64_t taken[2] = {0, 0}, exact[2] = {0, 0};
    for (const int size : {0, 1}) {
      const CandidateBins bins = test::random_bins(4, grid, size == 0 ? 500 : 8000, true);
      SelectionOptions options;
      options.criterion = criterion;
      options.stop = StopRule::count;
      options.max_lights = 4;
      LightPlanner planner(basis, bins, options);
      const std::int64_t before = allocations;
      const Selection selection = planner.select(options);
      taken[size] = allocations - before;
      exact[size] = selection.statistics.exact_evaluations;
      EXPECT_EQ(selection.lights.size(), 4U);
    }
    // Every candidate is looked at four times over. What is decided exactly may take memory: that
    // is a few of them, however many there are.
    const std::int64_t more = std::max<std::int64_t>(0, exact[1] - exact[0]);
    EXPECT_LT(more, 100);
    EXPECT_LE(taken[1], taken[0] + 20 * more) << taken[0] << " for 500 candidates";
    EXPECT_LT(taken[0], 1000);
  }
}

/// A ball, and one with a dent, which shades itself.
Mesh ball(bool dented) {
  Mesh mesh = test::sphere_mesh(4);
  if (!dented) return mesh;
  for (Eigen::Index i = 0; i < mesh.vertices.cols(); ++i) {
    const double depth =
        std::max(0.0, 0.9 - (mesh.vertices.col(i) - Eigen::Vector3d(0, -1, 0)).norm());
    mesh.vertices.col(i) *= 1 - depth;
  }
  return mesh;
}

TEST(PlannerMemory, BinningAllocatesNothingPerCandidateOrPoint) {
  for (const bool dented : {false, true}) {
    const Mesh mesh = ball(dented);
    const Occluder occluder(mesh);
    for (const bool distant : {true, false}) {
      std::int64_t taken[2] = {0, 0};
      int size = 60, lights = 100;
      for (std::int64_t& count : taken) {
        const SurfacePoints points =
            points_of_pixels(mesh, occluder, test::facing_camera(distant, 4, size, size), 1);
        const auto candidates = test::spread_lights(lights, distant, 3);
        const std::int64_t before = allocations;
        const BinningResult result =
            bin_candidates(points, candidates, {}, {}, {}, occluder, ShadowRays::needed, 1);
        count = allocations - before;
        EXPECT_GT(result.bins.cell.size(), 0U);
        // With rays by the thousand, most of them for points that others shade.
        EXPECT_EQ(result.statistics.rays_cast > lights, dented);
        EXPECT_EQ(result.statistics.in_shadow > lights, dented);
        size *= 2;
        lights *= 8;
      }
      EXPECT_LT(taken[1] - taken[0], 100) << "for 700 candidates more";
    }
  }
}

}  // namespace
}  // namespace lightrig
