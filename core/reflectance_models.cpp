#include "core/reflectance_models.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/check.h"

namespace lightrig {
namespace {

using Eigen::Array3d;
constexpr double pi = std::numbers::pi;

double ln_tangent(double cosine) {
  const double sine2 = std::max(1 - cosine * cosine, 1e-300);
  return 0.5 * std::log(sine2) - std::log(cosine);
}

Configuration make_configuration(double sin_h, double cos_h, double cos_d, double cos_a,
                                 double cos_b) {
  const double larger = std::min(std::max(cos_a, cos_b), 1.0), smaller = std::min(cos_a, cos_b);
  return {sin_h * sin_h, cos_h, cos_d, larger, smaller, ln_tangent(larger), ln_tangent(smaller)};
}

// Cosine between the directions: twice the difference angle.
double cos_between(const Configuration& c) { return 2 * c.cos_d * c.cos_d - 1; }

// The half vector after one direction was mirrored in the normal: its squared sine and its cosine.
struct BackHalf {
  double sin2, cos;
};
BackHalf back_half(const Configuration& c) {
  // |i' + o|² = 2 + 2 i'·o with i'·o = 2 ci co − i·o; both parts of the sum are exact at once.
  const double sum2 = std::max(2 + 2 * (2 * c.cos_i * c.cos_o - cos_between(c)), 1e-300);
  const double along = c.cos_i + c.cos_o;
  const double cos = std::min(along / std::sqrt(sum2), 1.0);
  return {std::max(0.0, 1 - along * along / sum2), cos};
}

// Hapke's approximation of Chandrasekhar's H function [Hapke 1981, eq. 10].
double h_function(double cosine, double root) { return (1 + 2 * cosine) / (1 + 2 * cosine * root); }

// Estevez & Kulla 2017: D = (2 + 1/r) sin^(1/r) θh / 2π.
double fibre_density(double r, double sin2_h) {
  return (2 + 1 / r) * std::pow(sin2_h, 0.5 / r) / (2 * pi);
}
// Their visibility term after Neubelt & Pettineo 2013.
double fibre_visibility(double cos_a, double cos_b) {
  return 1 / (4 * (cos_a + cos_b - cos_a * cos_b));
}

// Share of light from one direction that a lobe of weight 1 reflects.
Array3d facet_albedo(const Lobe& lobe, const SmithLambda& lambda, double cos_i) {
  constexpr int rings = 16, sectors = 8;
  const double sin_i = std::sqrt(std::max(0.0, 1 - cos_i * cos_i));
  const double ln_alpha = std::log(lobe.slopes.roughness);
  const double lambda_i = lambda(-ln_alpha - ln_tangent(cos_i));
  Array3d sum = Array3d::Zero();
  for (int r = 0; r < rings; ++r) {
    // Facets by equal shares of projected area, so that any sharpness is met evenly.
    const double tan2 = tan2_quantile(lobe.slopes, (r + 0.5) / rings);
    const double cos_h = 1 / std::sqrt(1 + tan2), sin_h = std::sqrt(tan2) * cos_h;
    for (int s = 0; s < sectors; ++s) {
      const double cos_d = cos_i * cos_h + sin_i * sin_h * std::cos(pi * (s + 0.5) / sectors);
      const double cos_o = 2 * cos_d * cos_h - cos_i;
      if (cos_d <= 0 || cos_o <= 0) continue;
      const double visible =
          lobe.masking == Masking::smith
              ? 1 / (1 + lambda_i + lambda(-ln_alpha - ln_tangent(std::min(cos_o, 1.0))))
              : std::min(1.0, 2 * cos_h * std::min(cos_i, cos_o) / cos_d);
      const double share = visible * cos_d / (cos_i * cos_h);
      if (lobe.kind == Lobe::Kind::facets)
        sum += share * fresnel(lobe.index, cos_d);
      else
        sum += share;
    }
  }
  return (sum / (rings * sectors)).min(1.0);
}

Array3d fibre_albedo(const Lobe& lobe, double cos_i) {
  constexpr int rings = 32, sectors = 32;
  const double sin_i = std::sqrt(std::max(0.0, 1 - cos_i * cos_i));
  double sum = 0;
  for (int r = 0; r < rings; ++r) {
    const double cos_o = (r + 0.5) / rings, sin_o = std::sqrt(1 - cos_o * cos_o);
    for (int s = 0; s < sectors; ++s) {
      const double between = cos_i * cos_o + sin_i * sin_o * std::cos(pi * (s + 0.5) / sectors);
      const double along = cos_i + cos_o;
      const double sin2_h = std::max(0.0, 1 - along * along / (2 + 2 * between));
      sum += fibre_density(lobe.slopes.roughness, sin2_h) * fibre_visibility(cos_i, cos_o) * cos_o;
    }
  }
  return Array3d::Constant(std::min(1.0, 2 * pi * sum / (rings * sectors)));
}

// How much of what enters at this cosine is left after one way through an absorbing layer.
Array3d absorbed(const Layer& layer, double cosine) {
  const double sine2 = (1 - cosine * cosine) / (layer.index * layer.index);
  return (-layer.optical_depth / std::sqrt(1 - sine2)).exp();
}

template <class Table>
Array3d at_cosine(const Table& table, double cosine) {
  const double x = cosine * static_cast<double>(table.cols() - 1);
  const Eigen::Index i = std::min(static_cast<Eigen::Index>(x), table.cols() - 2);
  const double t = x - static_cast<double>(i);
  return table.col(i) + t * (table.col(i + 1) - table.col(i));
}

}  // namespace

std::optional<Configuration> configuration(const HalfDiff& angles) {
  const double sin_h = std::sin(angles.theta_h), cos_h = std::cos(angles.theta_h);
  const double sin_d = std::sin(angles.theta_d), cos_d = std::cos(angles.theta_d);
  const double middle = cos_h * cos_d, offset = sin_h * sin_d * std::cos(angles.phi_d);
  if (!(middle - std::abs(offset) > 0) || cos_h <= 0 || cos_d <= 0) return std::nullopt;
  return make_configuration(sin_h, cos_h, cos_d, middle - offset, middle + offset);
}

ConfigurationGrid configuration_grid(const BivariateGrid& grid, int n_phi) {
  CHECK(n_phi >= 1);
  ConfigurationGrid result{grid, (n_phi + 1) / 2, {}};
  result.at.reserve(static_cast<std::size_t>(grid.cells()) *
                    static_cast<std::size_t>(result.per_cell));
  for (int i_h = 0; i_h < grid.n_h; ++i_h) {
    const double root = (i_h + 0.5) / grid.n_h, theta_h = root * root * pi / 2;
    const double sin_h = std::sin(theta_h), cos_h = std::cos(theta_h);
    for (int i_d = 0; i_d < grid.n_d; ++i_d) {
      const double theta_d = (i_d + 0.5) / grid.n_d * pi / 2;
      const double middle = cos_h * std::cos(theta_d), swing = sin_h * std::sin(theta_d);
      // Both directions are up while |cos φd| < middle/swing.
      const double first = middle >= swing ? 0 : std::acos(middle / swing);
      for (int k = 0; k < result.per_cell; ++k) {
        const double phi_d = first + (pi / 2 - first) * (k + 0.5) / result.per_cell;
        const double offset = swing * std::cos(phi_d);
        result.at.push_back(make_configuration(sin_h, cos_h, std::cos(theta_d),
                                               std::max(middle - offset, 1e-12), middle + offset));
      }
    }
  }
  return result;
}

LayeredReflectance::LayeredReflectance(std::vector<Layer> layers, const Body& body)
    : body_(body), layer_count_(layers.size()) {
  Transmission open = Transmission::Ones(), unabsorbed = Transmission::Ones();
  through_.push_back(open);
  for (std::size_t l = 0; l < layers.size(); ++l) {
    Transmission albedo = Transmission::Zero();
    for (const Lobe& lobe : layers[l].lobes) {
      lobes_.push_back({lobe, l, SmithLambda(lobe.slopes.tail), std::log(lobe.slopes.roughness)});
      const bool needed = l + 1 < layers.size() || body.kind != Body::Kind::none;
      for (int k = 0; needed && k <= nodes; ++k) {
        const double cosine = std::max(static_cast<double>(k) / nodes, 1e-4);
        const Array3d whole = lobe.kind == Lobe::Kind::fibres
                                  ? fibre_albedo(lobe, cosine)
                                  : facet_albedo(lobe, lobes_.back().lambda, cosine);
        albedo.col(k) += lobe.weight * whole;
      }
    }
    albedo_.push_back(albedo.min(1.0));
    unabsorbed *= 1 - albedo_.back();
    for (int k = 0; k <= nodes; ++k)
      open.col(k) *=
          (1 - albedo_.back().col(k)) * absorbed(layers[l], static_cast<double>(k) / nodes);
    through_.push_back(open);
  }
  // Light spread evenly over directions from below, by the share 2 ∫ T μ dμ of it, finds its way
  // out; the rest is thrown back into the body until it does.
  Array3d leaving = Array3d::Zero();
  for (int k = 0; k <= nodes; ++k) {
    const double weight = (k == 0 || k == nodes) ? 0.5 : 1.0;
    leaving += 2 * weight * unabsorbed.col(k) * (static_cast<double>(k) / nodes) / nodes;
  }
  body_scale_ = body_.albedo;
  if (body_.kind == Body::Kind::lambert) body_scale_ /= pi * leaving.max(1e-6);
  if (body_.kind == Body::Kind::oren_nayar) body_scale_ /= pi;
  if (body_.kind == Body::Kind::particulate) body_scale_ /= 4 * pi;
}

Array3d LayeredReflectance::layer_albedo(std::size_t layer, double cos_i) const {
  return at_cosine(albedo_[layer], cos_i);
}

Array3d LayeredReflectance::through(std::size_t layer, const Configuration& c) const {
  return at_cosine(through_[layer], c.cos_i) * at_cosine(through_[layer], c.cos_o);
}

// A lobe without its Fresnel term and weight, and without the density of facets where that depends
// on θh alone.
double LayeredReflectance::geometry(const PreparedLobe& prepared, const Configuration& c) const {
  const Lobe& lobe = prepared.lobe;
  if (lobe.kind == Lobe::Kind::fibres) return fibre_visibility(c.cos_i, c.cos_o);
  double cos_h = c.cos_h, cos_d = c.cos_d, density = 1;
  if (lobe.kind == Lobe::Kind::back) {
    const BackHalf back = back_half(c);
    density = normal_density(lobe.slopes, back.sin2, back.cos);
    cos_h = back.cos;
    cos_d = 0.5 * (c.cos_i + c.cos_o) / std::max(cos_h, 1e-150);
  }
  double visible = 0;
  if (lobe.masking == Masking::smith) {
    const double lambda_i = prepared.lambda(-prepared.ln_roughness - c.ln_tan_i);
    const double lambda_o = prepared.lambda(-prepared.ln_roughness - c.ln_tan_o);
    visible = 1 / (1 + lambda_i + lambda_o);
  } else {
    visible = std::min(1.0, 2 * cos_h * c.cos_o / cos_d);
  }
  return density * visible / (4 * c.cos_i * c.cos_o);
}

Array3d LayeredReflectance::body_value(const Configuration& c, double phase, double surge) const {
  switch (body_.kind) {
    case Body::Kind::none:
      return Array3d::Zero();
    case Body::Kind::lambert:
      return body_scale_;
    case Body::Kind::oren_nayar: {
      const double s2 = body_.sigma * body_.sigma;
      // cos φ sin α tan β of the paper, with α the larger angle: φ by the sides' cosines.
      const double azimuthal = std::max(0.0, cos_between(c) - c.cos_i * c.cos_o) / c.cos_i;
      return body_scale_ * (1 - 0.5 * s2 / (s2 + 0.33) + 0.45 * s2 / (s2 + 0.09) * azimuthal);
    }
    case Body::Kind::particulate: {
      const Array3d root = (1 - body_.albedo).max(0.0).sqrt();
      Array3d multiple;
      for (Eigen::Index k = 0; k < 3; ++k)
        multiple[k] = h_function(c.cos_i, root[k]) * h_function(c.cos_o, root[k]) - 1;
      return body_scale_ * (phase * surge + multiple) / (c.cos_i + c.cos_o);
    }
  }
  return Array3d::Zero();
}

namespace {

// Henyey & Greenstein's phase function of a grain; the scattering angle is π − 2θd.
double phase_function(double asymmetry, double cos_d) {
  const double cos_scattering = 1 - 2 * cos_d * cos_d;
  const double q = 1 + asymmetry * asymmetry - 2 * asymmetry * cos_scattering;
  return (1 - asymmetry * asymmetry) / (q * std::sqrt(q));
}

// Shadow-hiding surge about the way back [Hapke 1986]: 1 + B₀/(1 + tan(g/2)/h), phase angle g =
// 2θd.
double surge_factor(const Body& body, double cos_d) {
  const double tangent = std::sqrt(std::max(0.0, 1 - cos_d * cos_d)) / cos_d;
  return 1 + body.opposition / (1 + tangent / body.surge_width);
}

double row_factor(const Lobe& lobe, double sin2_h, double cos_h) {
  if (lobe.kind == Lobe::Kind::facets) return normal_density(lobe.slopes, sin2_h, cos_h);
  if (lobe.kind == Lobe::Kind::fibres) return fibre_density(lobe.slopes.roughness, sin2_h);
  return 1;
}

Array3d column_factor(const Lobe& lobe, double cos_d) {
  if (lobe.kind == Lobe::Kind::facets) return lobe.weight * fresnel(lobe.index, cos_d);
  return lobe.weight;
}

}  // namespace

Array3d LayeredReflectance::operator()(const HalfDiff& angles) const {
  const std::optional<Configuration> c = configuration(angles);
  if (!c) return Array3d::Zero();
  Array3d f = Array3d::Zero();
  for (const PreparedLobe& prepared : lobes_) {
    Array3d value = row_factor(prepared.lobe, c->sin2_h, c->cos_h) * geometry(prepared, *c) *
                    column_factor(prepared.lobe, c->cos_d);
    if (prepared.layer > 0) value *= through(prepared.layer, *c);
    f += value;
  }
  if (body_.kind != Body::Kind::none) {
    const double phase = phase_function(body_.asymmetry, c->cos_d);
    f += body_value(*c, phase, surge_factor(body_, c->cos_d)) * through(layer_count_, *c);
  }
  return f;
}

Eigen::ArrayXXd LayeredReflectance::tabulate_each(const ConfigurationGrid& configurations) const {
  const BivariateGrid& grid = configurations.grid;
  const int per_cell = configurations.per_cell;
  Eigen::Array<double, 3, Eigen::Dynamic> values =
      Eigen::Array<double, 3, Eigen::Dynamic>::Zero(3, Eigen::Index{grid.cells()} * per_cell);
  const auto first_of = [&](int cell) {
    return &configurations.at[static_cast<std::size_t>(cell) * static_cast<std::size_t>(per_cell)];
  };
  for (const PreparedLobe& prepared : lobes_) {
    Eigen::Array<double, 3, Eigen::Dynamic> columns(3, grid.n_d);
    for (int i_d = 0; i_d < grid.n_d; ++i_d)
      columns.col(i_d) = column_factor(prepared.lobe, first_of(grid.cell(0, i_d))->cos_d);
    for (int cell = 0; cell < grid.cells(); ++cell) {
      const Configuration* c = first_of(cell);
      const Array3d both =
          row_factor(prepared.lobe, c->sin2_h, c->cos_h) * columns.col(grid.column_d(cell));
      for (int k = 0; k < per_cell; ++k) {
        const Array3d hidden = both * geometry(prepared, c[k]);
        auto value = values.col(Eigen::Index{cell} * per_cell + k);
        value += prepared.layer == 0 ? hidden : Array3d(hidden * through(prepared.layer, c[k]));
      }
    }
  }
  if (body_.kind != Body::Kind::none) {
    for (int cell = 0; cell < grid.cells(); ++cell) {
      const Configuration* c = first_of(cell);
      const double phase = phase_function(body_.asymmetry, c->cos_d);
      const double surge = surge_factor(body_, c->cos_d);
      for (int k = 0; k < per_cell; ++k)
        values.col(Eigen::Index{cell} * per_cell + k) +=
            body_value(c[k], phase, surge) * through(layer_count_, c[k]);
    }
  }
  return values.transpose();
}

BrdfTable LayeredReflectance::tabulate(const ConfigurationGrid& configurations) const {
  return cell_means(tabulate_each(configurations), configurations);
}

BrdfTable cell_means(const Eigen::ArrayXXd& each, const ConfigurationGrid& configurations) {
  BrdfTable table{configurations.grid, Eigen::ArrayXXd(configurations.grid.cells(), 3)};
  const int per_cell = configurations.per_cell;
  for (int cell = 0; cell < configurations.grid.cells(); ++cell)
    table.f.row(cell) = each.middleRows(Eigen::Index{cell} * per_cell, per_cell).colwise().mean();
  return table;
}

}  // namespace lightrig
