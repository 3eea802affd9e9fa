// How much of real materials the built-in set can say, in numbers: projection of the fits of MERL
// (LIGHTRIG_DATA) on a basis of the built-in set and on one of other such fits, what seven planned
// lights reconstruct, the effective rank of both sets, and the cost of leaving a family out.

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <map>
#include <numbers>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "core/brdf_basis.h"
#include "core/brdf_error.h"
#include "core/builtin_materials.h"
#include "core/candidate_bins.h"
#include "core/check.h"
#include "core/fit.h"
#include "core/occlusion.h"
#include "core/planner.h"
#include "core/shapes.h"
#include "core/surface_points.h"
#include "tests/paths.h"

namespace lightrig {
namespace {

constexpr double floor_value = 1e-4;  // [1/sr]
constexpr int paper_components = 45;
constexpr int lights = 7;
// Standard deviation of what the basis cannot say [ln units]: of measured materials, and of another
// family of the built-in set.
constexpr double sigma_unseen = 0.3, sigma_builtin = 0.05;

double cpu_seconds() { return static_cast<double>(std::clock()) / CLOCKS_PER_SEC; }

std::vector<Material> fits_of_merl() {
  const char* named = std::getenv("LIGHTRIG_DATA");
  const std::filesystem::path folder =
      std::filesystem::path(named != nullptr
                                ? std::string(named)
                                : std::string(lightrig::test::source_dir) + "/../shared/data") /
      "materials/npf";
  std::vector<std::filesystem::path> files;
  std::error_code absent;
  for (const auto& entry : std::filesystem::directory_iterator(folder, absent))
    if (entry.path().extension() == ".binary") files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  std::vector<Material> materials;
  for (const auto& file : files) {
    std::ifstream in(file, std::ios::binary);
    const std::string text((std::istreambuf_iterator<char>(in)), {});
    MerlFindings findings;
    const auto table = decode_merl(std::as_bytes(std::span(text.data(), text.size())), findings);
    if (table) materials.push_back({file.stem().string(), "", "", to_bivariate(*table)});
  }
  return materials;
}

BrdfBasis basis_of(const std::vector<Material>& materials, ChannelLayout layout, int folds = 0) {
  BasisOptions options;
  options.layout = layout;
  options.floor = floor_value;
  options.sigma_folds = folds;
  const auto basis = make_basis(materials, options);
  CHECK(basis.has_value());
  return *basis;
}

// Percentage error of the best that k components can say of a material, over the cells where both
// have values.
double projection_error(const BrdfBasis& basis, Eigen::Index k, const BrdfTable& truth) {
  const int cells = basis.grid.cells();
  const bool stacked = basis.layout == ChannelLayout::stacked;
  double residual = 0, norm = 0;
  for (int first = 0; first < 3; first += stacked ? 3 : 1) {
    std::vector<Eigen::Index> rows;
    std::vector<double> y;
    for (int channel = first; channel < (stacked ? 3 : first + 1); ++channel) {
      for (int cell = 0; cell < cells; ++cell) {
        if (!basis.valid[static_cast<std::size_t>(cell)] || std::isnan(truth.f(cell, channel)))
          continue;
        rows.push_back(basis.row(cell, channel));
        y.push_back(map_value(basis.mapping, cell, truth.f(cell, channel)));
      }
    }
    const Eigen::VectorXd values =
        Eigen::Map<const Eigen::VectorXd>(y.data(), static_cast<Eigen::Index>(y.size()));
    const Eigen::MatrixXd V = basis.V(rows, Eigen::seqN(0, std::min(k, basis.components())));
    const Eigen::VectorXd centred = values - basis.mean(rows);
    // V restricted to these rows is no longer quite orthonormal.
    const Eigen::MatrixXd normal = V.transpose() * V;
    const Eigen::VectorXd c = normal.ldlt().solve(V.transpose() * centred);
    residual += (centred - V * c).squaredNorm();
    norm += values.squaredNorm();
  }
  return 100 * std::sqrt(residual / norm);
}

struct Summary {
  double mean = 0, median = 0, largest = 0;
};
Summary summary(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  Summary s;
  for (const double v : values) s.mean += v / static_cast<double>(values.size());
  s.median = 0.5 * (values[(values.size() - 1) / 2] + values[values.size() / 2]);
  s.largest = values.back();
  return s;
}

std::vector<double> projection(const BrdfBasis& basis, Eigen::Index k,
                               const std::vector<Material>& truths) {
  std::vector<double> errors;
  for (const Material& truth : truths) errors.push_back(projection_error(basis, k, truth.table));
  return errors;
}

// exp of the entropy of the variances, and how many components hold 99 % of them.
struct Rank {
  double effective = 0;
  int for_99_percent = 0;
};
Rank rank_of(const BrdfBasis& basis) {
  const Eigen::ArrayXd share = basis.stddev.array().square() / basis.stddev.squaredNorm();
  Rank rank;
  rank.effective = std::exp(-(share * share.max(1e-300).log()).sum());
  double held = 0;
  while (held < 0.99) held += share[rank.for_99_percent++];
  return rank;
}

// A sphere under distant light, seen from afar: the paper's simplest scene.
struct Scene {
  CandidateBins measurable;  ///< within the default grazing limits
  CandidateBins everywhere;
};
Scene sphere_scene() {
  const Mesh mesh = make_sphere(0.05, 1);
  const Occluder occluder(mesh);
  CameraModel camera;
  camera.projection = CameraModel::Projection::orthographic;
  camera.width = camera.height = 100;
  camera.fx = camera.fy = 900;
  camera.cx = camera.cy = 49.5;
  camera.camera_from_world = look_at({0, -1, 0}, {0, 0, 0}, {0, 0, 1});
  const SurfacePoints points = points_of_pixels(mesh, occluder, camera, 1);
  std::vector<LightPosition> candidates;
  for (int i = 0; i < 1000; ++i) {  // a golden spiral over the whole sphere of directions
    const double z = 1 - (2 * i + 1) / 1000.0, phi = i * std::numbers::pi * (3 - std::sqrt(5.0));
    const double r = std::sqrt(1 - z * z);
    candidates.push_back({true, {r * std::cos(phi), r * std::sin(phi), z}});
  }
  const auto bins = [&](const GrazingLimits& limits) {
    return bin_candidates(points, candidates, {}, {}, limits, occluder, ShadowRays::needed, 1).bins;
  };
  return {bins(GrazingLimits{}), bins(no_grazing_limits)};
}

BrdfObservations observed(const BrdfBasis& basis, const std::set<int>& cells,
                          const BrdfTable& truth) {
  BrdfObservations seen;
  for (int channel = 0; channel < 3; ++channel) {
    for (const int cell : cells) {
      const double f = truth.f(cell, channel);
      if (!basis.valid[static_cast<std::size_t>(cell)] || std::isnan(f)) continue;
      BrdfObservation row;
      row.cell = cell;
      row.channel = static_cast<std::int8_t>(channel);
      row.count = 1;
      row.f = f;
      seen.rows.push_back(row);
    }
  }
  return seen;
}

// What seven planned lights and MAP make of the truths, free of noise.
std::vector<double> reconstruction(const BrdfBasis& basis, const CandidateBins& bins, double sigma,
                                   const std::vector<Material>& truths) {
  SelectionOptions selection;
  selection.criterion = Criterion::a_optimal;
  selection.stop = StopRule::count;
  selection.max_lights = lights;
  selection.sigma = sigma;
  const Eigen::Index planned = std::min<Eigen::Index>(paper_components, basis.components());
  const Selection plan = select_lights(truncated(basis, planned), bins, selection);
  std::set<int> cells;
  for (const SelectedLight& light : plan.lights)
    for (const std::int32_t cell : bins.of(light.candidate)) cells.insert(cell);
  FitOptions options;
  options.model_sigma = sigma;
  std::vector<double> errors;
  for (const Material& truth : truths) {
    const BrdfObservations seen = observed(basis, cells, truth.table);
    const Coefficients c = fit(basis, std::span(&seen, 1), 3, options);
    errors.push_back(brdf_error(evaluate(basis, c.c), truth.table, floor_value).percent_log);
  }
  return errors;
}

void print_head(const char* truths) {
  fmt::print("\n{:<32}{:>8}{:>8}{:>8}{:>8}{:>10}{:>8}{:>10}{:>8}\n", truths, "mean", "K=45", "K=45",
             "all K", "7 lights", "", "7 lights", "");
  fmt::print("{:<32}{:>8}{:>8}{:>8}{:>8}{:>10}{:>8}{:>10}{:>8}\n", "", "alone", "mean", "median",
             "mean", "mean", "median", "to 90 deg", "median");
}

// Errors of every truth; those of several bases, each with truths of its own, are joined.
struct Errors {
  std::vector<double> mean_alone, at_45, all, seven, seven_to_90;

  void join(const Errors& other) {
    for (auto part :
         {&Errors::mean_alone, &Errors::at_45, &Errors::all, &Errors::seven, &Errors::seven_to_90})
      (this->*part).insert((this->*part).end(), (other.*part).begin(), (other.*part).end());
  }
};

Errors errors_of(const std::vector<Material>& training, const std::vector<Material>& truths,
                 ChannelLayout layout, double sigma, const Scene& scene) {
  const BrdfBasis basis = basis_of(training, layout);
  const BrdfBasis fitted = truncated(basis, std::min<Eigen::Index>(150, basis.components()));
  return {projection(basis, 0, truths), projection(basis, paper_components, truths),
          projection(basis, basis.components(), truths),
          reconstruction(fitted, scene.measurable, sigma, truths),
          reconstruction(fitted, scene.everywhere, sigma, truths)};
}

double print_row(const std::string& what, const Errors& errors) {
  const Summary at_45 = summary(errors.at_45), limited = summary(errors.seven),
                unlimited = summary(errors.seven_to_90);
  fmt::print("{:<32}{:>8.1f}{:>8.2f}{:>8.2f}{:>8.2f}{:>10.2f}{:>8.2f}{:>10.2f}{:>8.2f}\n", what,
             summary(errors.mean_alone).mean, at_45.mean, at_45.median, summary(errors.all).mean,
             limited.mean, limited.median, unlimited.mean, unlimited.median);
  std::fflush(stdout);
  return at_45.mean;
}

double coverage_row(const std::string& what, const std::vector<Material>& training,
                    const std::vector<Material>& truths, ChannelLayout layout, double sigma,
                    const Scene& scene) {
  return print_row(what, errors_of(training, truths, layout, sigma, scene));
}

// Every fit is the truth once, to a basis from four fifths of the fits that it is not in, drawn by
// chance: so the truths are those of the rows above, and the bases as large as the paper's of MERL.
double folds_row(const std::vector<Material>& fits, const Scene& scene) {
  constexpr std::size_t folds = 5;
  std::vector<std::size_t> order(fits.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::mt19937_64 random(1);
  std::shuffle(order.begin(), order.end(), random);
  Errors errors;
  for (std::size_t fold = 0; fold < folds; ++fold) {
    std::vector<Material> training, truths;
    for (std::size_t i = 0; i < order.size(); ++i)
      (i % folds == fold ? truths : training).push_back(fits[order[i]]);
    errors.join(errors_of(training, truths, ChannelLayout::columns, sigma_unseen, scene));
  }
  return print_row("the other 80 fits, five folds", errors);
}

void print_families(const std::vector<Material>& builtin, const Scene& scene) {
  print_head("built-in, one family held out");
  std::set<std::string> families;
  for (const Material& m : builtin) families.insert(m.family);
  for (const std::string& family : families) {
    std::vector<Material> training, truths;
    for (const Material& m : builtin) (m.family == family ? truths : training).push_back(m);
    coverage_row(fmt::format("{} ({})", family, truths.size()), training, truths,
                 ChannelLayout::columns, sigma_builtin, scene);
  }
}

// Percentage error of the bivariate table itself: what a material loses when its values over φd are
// replaced by their mean.
double bivariate_loss(const BuiltinMaterial& material, const BrdfTable& table) {
  double residual = 0, norm = 0;
  for (int cell = 0; cell < table.grid.cells(); ++cell) {
    HalfDiff angles = cell_centre(table.grid, cell);
    for (int k = 0; k < 8; ++k) {
      angles.phi_d = std::numbers::pi * (k + 0.5) / 16;
      if (!configuration(angles)) continue;
      const Eigen::Array3d ln_f = material.reflectance(angles).max(floor_value).log();
      residual += (table.f.row(cell).transpose().max(floor_value).log() - ln_f).square().sum();
      norm += ln_f.square().sum();
    }
  }
  return 100 * std::sqrt(residual / norm);
}

double print_bivariate_loss(const std::vector<Material>& tables) {
  std::map<std::string, std::vector<double>> by_family;
  std::vector<double> all;
  for (const Material& m : tables) {
    all.push_back(bivariate_loss(*find_builtin(m.name), m.table));
    by_family[m.family].push_back(all.back());
  }
  fmt::print("\n{:<32}{:>8}{:>8}{:>8}\n", "error of the mean over phi_d", "mean", "median", "most");
  for (const auto& [family, losses] : by_family) {
    const Summary s = summary(losses);
    fmt::print("{:<32}{:>8.2f}{:>8.2f}{:>8.2f}\n", family, s.mean, s.median, s.largest);
  }
  return summary(all).mean;
}

int run() {
  fmt::print(
      "Percentage error 100 |ln f' - ln f| / |ln f| over the bivariate grid, f in 1/sr, floor {},\n"
      "over the truths. K=45, all K: best projection on so many components. 7 lights: A-optimal\n"
      "lights on a sphere, distant light and view, within 80 degrees of grazing and to 90; MAP "
      "with\n"
      "up to 150 components, no noise, sigma {} (fits) and {} (built-in). One thread.\n",
      floor_value, sigma_unseen, sigma_builtin);
  const double start = cpu_seconds();
  const std::size_t count = builtin_materials().size();
  const double made = cpu_seconds();
  const std::vector<Material> builtin = builtin_tables({}, 16);
  const double tabulated = cpu_seconds();
  fmt::print(
      "{} built-in materials made in {:.3f} s, tabulated (90 x 90 x 16) in {:.3f} s of CPU\n",
      count, made - start, tabulated - made);
  const Scene scene = sphere_scene();
  const BrdfBasis whole = basis_of(builtin, ChannelLayout::columns, 5);
  const Rank rank = rank_of(whole);
  fmt::print("model sigma by leave-materials-out within the set: {:.3f}\n", whole.model_sigma);
  double at_45 = NAN, at_45_stacked = NAN, at_45_fits = NAN, fits_rank = NAN;
  const std::vector<Material> fits = fits_of_merl();
  if (fits.empty()) {
    fmt::print("\nfits of MERL: skipped, LIGHTRIG_DATA holds no materials/npf\n");
  } else {
    const Rank real = rank_of(basis_of(fits, ChannelLayout::columns));
    fits_rank = real.effective;
    fmt::print(
        "\neffective rank: built-in {:.2f}, {} fits of MERL {:.2f}; components for 99 %: {} and "
        "{}\n",
        rank.effective, fits.size(), real.effective, rank.for_99_percent, real.for_99_percent);
    print_head(fmt::format("truth: the {} fits; basis:", fits.size()).c_str());
    at_45 = coverage_row("built-in, channels as columns", builtin, fits, ChannelLayout::columns,
                         sigma_unseen, scene);
    at_45_stacked = coverage_row("built-in, channels stacked", builtin, fits,
                                 ChannelLayout::stacked, sigma_unseen, scene);
    at_45_fits = folds_row(fits, scene);
  }
  const double loss = print_bivariate_loss(builtin);
  print_families(builtin, scene);
  fmt::print(
      "materials={} projection_45_percent={:.2f} projection_45_stacked_percent={:.2f} "
      "projection_45_of_fits_percent={:.2f} effective_rank={:.2f} effective_rank_fits={:.2f} "
      "bivariate_loss_percent={:.2f} make_s={:.3f} tabulate_s={:.3f}\n",
      count, at_45, at_45_stacked, at_45_fits, rank.effective, fits_rank, loss, made - start,
      tabulated - made);
  return 0;
}

}  // namespace
}  // namespace lightrig

int main() { return lightrig::run(); }
