#pragma once

#include <cstddef>
#include <limits>
#include <vector>

namespace lightrig {

/// Slopes of the facets of a rough surface: a bivariate Student t of root-mean-square scale
/// `roughness` [Ribardiere 2017]. tail γ = ∞ is Beckmann's Gaussian [Beckmann & Spizzichino 1963;
/// Cook & Torrance 1982], γ = 2 is GGX [Trowbridge & Reitz 1975; Walter 2007]; the smaller γ > 1.5,
/// the longer the tail of the highlight.
struct SlopeDistribution {
  static constexpr double beckmann = std::numeric_limits<double>::infinity();
  double roughness = 0.1;  ///< α > 0
  double tail = 2;         ///< γ > 1.5
  bool operator==(const SlopeDistribution&) const = default;
};

/// Density of facet normals D(h) [1/sr]; its integral times cos θh over the hemisphere is 1.
double normal_density(const SlopeDistribution& slopes, double sin2_h, double cos_h);

/// tan²θh below which a share u of the projected facet area lies; inverts the distribution.
double tan2_quantile(const SlopeDistribution& slopes, double u);

/// Smith's Λ for slopes of one tail, a function of a = 1/(α tan θ) alone: masking is 1/(1 + Λ),
/// masking and shadowing together 1/(1 + Λi + Λo) [Smith 1967; Heitz 2014, eq. 99]. Tabulated in
/// ln a and linear between: masking is right to 3e-4 of itself.
class SmithLambda {
 public:
  explicit SmithLambda(double tail);
  /// ln_a may be anything, infinities included.
  double operator()(double ln_a) const {
    const double x = (ln_a - first) / step;
    if (x >= last) return 0;
    if (!(x > 0)) return beyond(ln_a);
    const auto i = static_cast<std::size_t>(x);
    const double t = x - static_cast<double>(i);
    return table_[i] + t * (table_[i + 1] - table_[i]);
  }

 private:
  static constexpr double first = -9, step = 1.0 / 32, last = 18 * 32;
  double beyond(double ln_a) const;
  std::vector<double> table_;
};

}  // namespace lightrig
