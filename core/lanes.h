#pragma once

#include <cstdint>

namespace lightrig {

/// Eight numbers, wherever they lie in memory. The compiler makes them one, two or four registers,
/// by the instruction set of the function they are used in; sums add in one order everywhere.
using Lanes [[gnu::vector_size(64), gnu::aligned(8), gnu::may_alias]] = double;
inline constexpr int lane_width = 8;

[[gnu::always_inline]] inline const Lanes& lanes_at(const double* p) {
  return *reinterpret_cast<const Lanes*>(p);
}
[[gnu::always_inline]] inline Lanes& lanes_at(double* p) { return *reinterpret_cast<Lanes*>(p); }

[[gnu::always_inline]] inline double sum_of(const Lanes& v) {
  return ((v[0] + v[4]) + (v[2] + v[6])) + ((v[1] + v[5]) + (v[3] + v[7]));
}

#if defined(__x86_64__)
template <class Body>
[[gnu::target("arch=x86-64-v4,prefer-vector-width=512")]] inline auto on_level_4(const Body& body) {
  return body();
}
template <class Body>
[[gnu::target("arch=x86-64-v3")]] inline auto on_level_3(const Body& body) {
  return body();
}
#endif

/// Runs a body, which must be always_inline with all it calls, as compiled for an x86-64 level
/// (vector_level()).
template <class Body>
inline auto on_level(int level, const Body& body) {
#if defined(__x86_64__)
  if (level >= 4) return on_level_4(body);
  if (level == 3) return on_level_3(body);
#endif
  return body();
}

}  // namespace lightrig
