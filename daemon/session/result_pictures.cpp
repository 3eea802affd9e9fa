#include "daemon/session/result_pictures.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include "daemon/session/frame_file.h"
#include "daemon/session/image_sites.h"
#include "daemon/session/sphere_view.h"

namespace lightrig {
namespace {

constexpr float nan = std::numeric_limits<float>::quiet_NaN();
constexpr int cell_pixels = 3;      ///< edge of a cell in the big tables
constexpr int sphere_pixels = 220;  ///< diameter; shown at four fifths, which smooths its rim
constexpr int gap = 8;

double mean_of(const BrdfTable& table, Eigen::Index cell) {
  double sum = 0;
  for (Eigen::Index c = 0; c < table.f.cols(); ++c) sum += table.f(cell, c);
  return sum / static_cast<double>(table.f.cols());
}

Result<StoredPicture> stored(const std::string& file, const Picture& picture, double shown) {
  auto png = encode_png(picture.width, picture.height, 4, picture.rgba);
  if (!png) return tl::unexpected(with_context("draw " + file, png.error()));
  return StoredPicture{file, static_cast<int>(std::lround(shown * picture.width)), std::move(*png)};
}

// The stored pictures of a result, or the first error met while storing them.
class Album {
 public:
  explicit Album(const Patience& patience) : patience_(patience) {}
  StoredPicture add(const std::string& file, const Picture& picture, double shown = 1) {
    patience_.tell();
    auto kept = stored(file, picture, shown);
    if (kept) return std::move(*kept);
    if (!error_) error_ = kept.error();
    return {};
  }
  const std::optional<Error>& error() const { return error_; }

 private:
  const Patience& patience_;
  std::optional<Error> error_;
};

void draw_tables(const Reconstruction& fit, double floor, const BrdfTable* reference, Album& album,
                 ResultPictures& out) {
  const BivariateGrid& grid = fit.brdf.grid;
  std::tie(out.f_low, out.f_high) =
      table_range(reference != nullptr ? *reference : fit.brdf, floor);
  out.table = album.add("table.png", table_picture(fit.brdf, reference, out.f_low, out.f_high));
  if (reference != nullptr) {
    const std::vector<float> difference = table_difference(fit.brdf, *reference, floor);
    out.table_difference_range = std::log(1.5);
    out.table_difference =
        album.add("table-difference.png",
                  enlarged(false_colour(grid.n_h, grid.n_d, difference, -out.table_difference_range,
                                        out.table_difference_range, diverging_colour),
                           cell_pixels));
  }
  std::vector<float> sigma(static_cast<std::size_t>(grid.cells()));
  std::vector<float> sorted;
  for (int cell = 0; cell < grid.cells(); ++cell) {
    const auto value = static_cast<float>(fit.log_stddev.row(cell).mean());
    const bool valid = std::isfinite(mean_of(fit.brdf, cell));
    sigma[static_cast<std::size_t>(cell)] = valid ? value : nan;
    if (valid && std::isfinite(value)) sorted.push_back(value);
  }
  std::sort(sorted.begin(), sorted.end());
  const double most =
      sorted.empty() ? 1.0 : static_cast<double>(sorted[(sorted.size() - 1) * 99 / 100]);
  out.uncertainty_high = std::max(0.02, most);
  out.uncertainty = album.add("uncertainty.png",
                              enlarged(false_colour(grid.n_h, grid.n_d, as_image(grid, sigma), 0,
                                                    out.uncertainty_high, sequential_colour),
                                       cell_pixels));
}

std::vector<float> cells_shown(const BivariateGrid& grid, const BrdfObservations& light) {
  std::vector<float> shown(static_cast<std::size_t>(grid.cells()), 0.0F);
  for (const BrdfObservation& row : light.rows) shown[static_cast<std::size_t>(row.cell)] = 1;
  return shown;
}

// A light's own cells strong, the others faint, over nothing.
Picture bins_picture(const BivariateGrid& grid, const std::vector<float>& own,
                     const std::vector<float>& all) {
  std::vector<float> values(own.size(), nan);
  for (std::size_t i = 0; i < own.size(); ++i) {
    if (own[i] > 0) {
      values[i] = 1;
    } else if (all[i] > 0) {
      values[i] = 0;
    }
  }
  const auto colour = [](double t) {
    return t > 0.5 ? Eigen::Array3i(214, 120, 20) : Eigen::Array3i(150, 160, 170);
  };
  return enlarged(false_colour(grid.n_h, grid.n_d, as_image(grid, values), 0, 1, colour), 2);
}

void draw_coverage(const Reduction& reduction, Album& album, ResultPictures& out) {
  const BivariateGrid& grid = reduction.basis().grid;
  std::vector<float> all(static_cast<std::size_t>(grid.cells()), 0.0F);
  std::vector<std::vector<float>> own;
  for (std::size_t i = 0; i < reduction.shots().size(); ++i) {
    own.push_back(cells_shown(grid, reduction.observations()[i]));
    if (reduction.shots()[i].shot.held_out) continue;
    for (std::size_t k = 0; k < all.size(); ++k) all[k] += own.back()[k];
  }
  const float most = *std::max_element(all.begin(), all.end());
  out.coverage_high = std::max(2, static_cast<int>(most));
  std::vector<float> counts(all);
  for (float& count : counts) count = count > 0 ? count : nan;
  out.coverage =
      album.add("coverage.png", enlarged(false_colour(grid.n_h, grid.n_d, as_image(grid, counts), 1,
                                                      out.coverage_high, sequential_colour),
                                         cell_pixels));
  for (std::size_t i = 0; i < own.size(); ++i) {
    const std::string& name = reduction.shots()[i].shot.name;
    ResultPictures::Light& light = out.lights.emplace_back();
    light.name = name;
    light.bins = album.add(name + "-cells.png", bins_picture(grid, own[i], all), 0.8);
  }
}

// Part of the picture that the object fills, so that a small object is not drawn tiny.
struct Crop {
  int left = 0, top = 0, width = 0, height = 0;
};

Crop object_crop(const LinearImage& image) {
  int left = image.width, right = 0, top = image.height, bottom = 0;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width) +
                     static_cast<std::size_t>(x);
      if (!image.pixels[i].isFinite().all()) continue;
      left = std::min(left, x);
      right = std::max(right, x + 1);
      top = std::min(top, y);
      bottom = std::max(bottom, y + 1);
    }
  }
  if (left >= right) return {0, 0, image.width, image.height};
  return {left, top, right - left, bottom - top};
}

Picture cropped(const Picture& picture, const Crop& crop) {
  Picture out{crop.width, crop.height, {}};
  for (int y = 0; y < crop.height; ++y) {
    const auto first = picture.rgba.begin() +
                       4 * (static_cast<std::ptrdiff_t>(crop.top + y) * picture.width + crop.left);
    out.rgba.insert(out.rgba.end(), first, first + 4 * static_cast<std::ptrdiff_t>(crop.width));
  }
  return out;
}

void draw_lights(const Reduction& reduction, const Occluder& occluder, int threads, Album& album,
                 ResultPictures& out) {
  const BrdfLookup brdf(reduction.reconstruction().brdf);
  for (std::size_t i = 0; i < reduction.shots().size(); ++i) {
    const ReducedShot& shot = reduction.shots()[i];
    const ImageSites* sites = reduction.image_sites(i);
    if (sites == nullptr) return;
    const std::vector<float> predicted =
        predicted_radiance(*sites, brdf, shot.light, shot.strength, occluder, threads);
    const LinearImage captured = block_image(*sites, shot.site_radiance);
    const ToneMapping tone = choose_tone(captured);
    const Crop crop = object_crop(captured);
    const std::vector<Picture> row{
        cropped(tone_mapped(captured, tone), crop),
        cropped(tone_mapped(block_image(*sites, predicted), tone), crop),
        cropped(
            false_colour(sites->width, sites->height,
                         relative_difference(*sites, shot.site_radiance, predicted),
                         -out.image_difference_range, out.image_difference_range, diverging_colour),
            crop)};
    // Small pictures are enlarged whole pixels at a time; all are shown about as wide.
    const int factor = std::max(1, 180 / std::max(1, crop.width));
    const Picture strip = enlarged(beside(row, std::max(2, gap / factor)), factor);
    out.lights[i].images =
        album.add(shot.shot.name + ".png", strip, std::min(1.0, 560.0 / strip.width));
  }
}

void draw_spheres(const BrdfTable& brdf, const BrdfTable* reference,
                  const Environment& surroundings, int threads, Album& album, ResultPictures& out) {
  std::vector<const BrdfTable*> materials{&brdf};
  if (reference != nullptr) materials.push_back(reference);
  const std::vector<LinearImage> images =
      render_spheres(materials, surroundings, sphere_pixels, threads);
  const ToneMapping tone = choose_tone(images.back());
  std::vector<Picture> row;
  for (const LinearImage& image : images) row.push_back(tone_mapped(image, tone));
  out.spheres = album.add("sphere.png", beside(row, 3 * gap), 0.8);
}

}  // namespace

std::vector<float> as_image(const BivariateGrid& grid, const std::vector<float>& cells) {
  std::vector<float> image(cells.size());
  for (int i_d = 0; i_d < grid.n_d; ++i_d) {
    for (int i_h = 0; i_h < grid.n_h; ++i_h) {
      image[static_cast<std::size_t>((grid.n_d - 1 - i_d) * grid.n_h + i_h)] =
          cells[static_cast<std::size_t>(grid.cell(i_h, i_d))];
    }
  }
  return image;
}

std::pair<double, double> table_range(const BrdfTable& table, double floor) {
  std::vector<double> values;
  for (Eigen::Index cell = 0; cell < table.f.rows(); ++cell) {
    const double f = mean_of(table, cell);
    if (std::isfinite(f)) values.push_back(std::max(f, floor));
  }
  if (values.empty()) return {floor, 10 * floor};
  std::sort(values.begin(), values.end());
  const auto last = static_cast<double>(values.size() - 1);
  const double low = values[static_cast<std::size_t>(0.005 * last)];
  const double high = values[static_cast<std::size_t>(0.999 * last)];
  return {low, std::max(high, 1.5 * low)};
}

Picture table_picture(const BrdfTable& table, const BrdfTable* beside_it, double low, double high) {
  const auto draw = [&](const BrdfTable& one) {
    std::vector<float> values(static_cast<std::size_t>(one.grid.cells()));
    for (int cell = 0; cell < one.grid.cells(); ++cell) {
      const double f = mean_of(one, cell);
      values[static_cast<std::size_t>(cell)] =
          std::isfinite(f) ? static_cast<float>(std::log(std::max(f, low) / low)) : nan;
    }
    return enlarged(false_colour(one.grid.n_h, one.grid.n_d, as_image(one.grid, values), 0,
                                 std::log(high / low), sequential_colour),
                    cell_pixels);
  };
  std::vector<Picture> row{draw(table)};
  if (beside_it != nullptr) row.push_back(draw(*beside_it));
  return beside(row, gap);
}

std::vector<float> table_difference(const BrdfTable& a, const BrdfTable& b, double floor) {
  std::vector<float> difference(static_cast<std::size_t>(a.grid.cells()), nan);
  for (int cell = 0; cell < a.grid.cells(); ++cell) {
    const double fa = mean_of(a, cell), fb = mean_of(b, cell);
    if (!std::isfinite(fa) || !std::isfinite(fb)) continue;
    difference[static_cast<std::size_t>(cell)] =
        static_cast<float>(std::log(std::max(fa, floor) / std::max(fb, floor)));
  }
  return as_image(a.grid, difference);
}

Result<ResultPictures> draw_pictures(const Reduction& reduction, const Occluder& occluder,
                                     const BrdfTable* reference, const Environment& surroundings,
                                     int threads, const Patience& patience) {
  Album album(patience);
  ResultPictures out;
  out.with_reference = reference != nullptr;
  const Reconstruction& fit = reduction.reconstruction();
  draw_tables(fit, reduction.basis().mapping.floor, reference, album, out);
  draw_coverage(reduction, album, out);
  draw_lights(reduction, occluder, threads, album, out);
  draw_spheres(fit.brdf, reference, surroundings, threads, album, out);
  if (album.error()) return tl::unexpected(*album.error());
  return out;
}

}  // namespace lightrig
