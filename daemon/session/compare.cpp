#include "daemon/session/compare.h"

#include <fmt/format.h>

#include <cmath>
#include <system_error>

#include "daemon/session/durable_file.h"
#include "daemon/session/frame_file.h"
#include "daemon/session/result_pictures.h"
#include "daemon/session/sphere_view.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;

constexpr int sphere_pixels = 270;  ///< as wide as a table picture
constexpr int merl_azimuths = 180;

BrdfTable one_channel(const BrdfTable& table) { return {table.grid, table.f.rowwise().mean()}; }

// The factor that best explains a/b, in the mean of logarithms.
double mean_ratio(const BrdfTable& a, const BrdfTable& b, double floor) {
  double sum = 0;
  int count = 0;
  for (Eigen::Index i = 0; i < a.f.size(); ++i) {
    const double fa = a.f.data()[i], fb = b.f.data()[i];
    if (!std::isfinite(fa) || !std::isfinite(fb)) continue;
    sum += std::log(std::max(fa, floor) / std::max(fb, floor));
    ++count;
  }
  return count > 0 ? std::exp(sum / count) : 1;
}

Result<std::vector<std::byte>> comparison_png(const BrdfTable& a, const BrdfTable& b, double floor,
                                              int threads) {
  const std::vector<const BrdfTable*> both{&a, &b};
  const std::vector<LinearImage> spheres =
      render_spheres(both, studio_environment(), sphere_pixels, threads);
  const ToneMapping tone = choose_tone(spheres[1]);
  const auto [low, high] = table_range(b, floor);
  const double range = std::log(1.5);
  const Picture difference =
      enlarged(false_colour(a.grid.n_h, a.grid.n_d, table_difference(a, b, floor), -range, range,
                            diverging_colour),
               3);
  const std::vector<Picture> row{tone_mapped(spheres[0], tone), tone_mapped(spheres[1], tone),
                                 table_picture(a, &b, low, high), difference};
  const Picture picture = beside(row, 16);
  return encode_png(picture.width, picture.height, 4, picture.rgba);
}

}  // namespace

Result<BrdfTable> load_brdf(const fs::path& file_or_session) {
  std::error_code ignored;
  fs::path file = file_or_session;
  if (fs::is_directory(file, ignored)) {
    // A session folder, the folder a reduction wrote to, or its result.
    file = fs::exists(file / "brdf.binary", ignored) ? file / "brdf.binary"
                                                     : file / "result" / "brdf.binary";
    if (!fs::exists(file, ignored)) {
      return fail(ErrorCode::not_found,
                  fmt::format("load a BRDF from '{}': it has no result/brdf.binary; run 'lightrig "
                              "reduce' on it first",
                              file_or_session.string()));
    }
  }
  const auto bytes = read_file(file);
  if (!bytes) return tl::unexpected(with_context("load a BRDF", bytes.error()));
  MerlFindings findings;
  const auto merl = decode_merl(std::as_bytes(std::span(*bytes)), findings);
  if (!merl) {
    return tl::unexpected(with_context("load a BRDF from '" + file.string() + "'", merl.error()));
  }
  return to_bivariate(*merl);
}

Result<Comparison> compare(const BrdfTable& a, const BrdfTable& b, double floor, int threads) {
  if (!(a.grid == b.grid)) {
    return fail(ErrorCode::invalid_input,
                fmt::format("compare two BRDFs: one has a grid of {} × {}, the other of {} × {}",
                            a.grid.n_h, a.grid.n_d, b.grid.n_h, b.grid.n_d));
  }
  if (a.f.cols() != b.f.cols()) {
    return compare(one_channel(a), one_channel(b), floor, threads);
  }
  Comparison comparison;
  comparison.error = brdf_error(a, b, floor);
  if (comparison.error.cells == 0) {
    return fail(ErrorCode::invalid_input, "compare two BRDFs: no cell has a value in both");
  }
  comparison.mean_ratio = mean_ratio(a, b, floor);
  const BrdfTable scaled{a.grid, a.f / comparison.mean_ratio};
  comparison.percent_log_scaled = brdf_error(scaled, b, floor).percent_log;
  auto png = comparison_png(a, b, floor, threads);
  if (!png) return tl::unexpected(png.error());
  comparison.png = std::move(*png);
  return comparison;
}

Result<void> export_merl(const fs::path& file_or_session, const fs::path& out) {
  const auto table = load_brdf(file_or_session);
  if (!table) return tl::unexpected(table.error());
  if (!(table->grid == BivariateGrid{})) {
    return fail(ErrorCode::invalid_input,
                fmt::format("export to MERL: the grid is {} × {}, MERL's is 90 × 90",
                            table->grid.n_h, table->grid.n_d));
  }
  BrdfTable colours = *table;
  // MERL files hold three channels: a monochrome result stands in all of them.
  if (colours.f.cols() == 1) colours.f = colours.f.replicate(1, 3).eval();
  return write_durably(out, encode_merl(to_merl(colours, merl_azimuths)));
}

}  // namespace lightrig
