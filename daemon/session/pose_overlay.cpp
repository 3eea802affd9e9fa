#include "daemon/session/pose_overlay.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>

#include "core/half_diff.h"
#include "daemon/session/frame_file.h"
#include "daemon/session/pose_check.h"
#include "daemon/session/session_folder.h"

namespace lightrig {
namespace {

struct Rgb {
  int width = 0, height = 0;
  std::vector<std::uint8_t> pixels;  // (height · width · 3)

  void set(int x, int y, const std::array<std::uint8_t, 3>& colour) {
    if (x < 0 || y < 0 || x >= width || y >= height) return;
    const std::size_t i = 3 * (static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                               static_cast<std::size_t>(x));
    std::copy(colour.begin(), colour.end(), pixels.begin() + static_cast<std::ptrdiff_t>(i));
  }
};

Result<Rgb> decoded(const std::string& png) {
  try {
    OIIO::Filesystem::IOMemReader memory(png.data(), png.size());
    auto input = OIIO::ImageInput::open("frame.png", nullptr, &memory);
    if (!input)
      return fail(ErrorCode::invalid_input,
                  fmt::format("draw over the picture: {}", OIIO::geterror()));
    const OIIO::ImageSpec& spec = input->spec();
    const auto channels = static_cast<std::size_t>(spec.nchannels);
    std::vector<std::uint8_t> raw(static_cast<std::size_t>(spec.width) *
                                  static_cast<std::size_t>(spec.height) * channels);
    if (!input->read_image(0, 0, 0, spec.nchannels, OIIO::TypeDesc::UINT8, raw.data()))
      return fail(ErrorCode::invalid_input,
                  fmt::format("draw over the picture: {}", input->geterror()));
    Rgb rgb{spec.width, spec.height, {}};
    for (std::size_t i = 0; i < raw.size(); i += channels)
      for (std::size_t c = 0; c < 3; ++c) rgb.pixels.push_back(raw[i + std::min(c, channels - 1)]);
    return rgb;
  } catch (const std::exception& e) {
    return fail(ErrorCode::invalid_input, fmt::format("draw over the picture: {}", e.what()));
  }
}

constexpr std::array<std::uint8_t, 3> outline_colour{60, 230, 90}, ring_colour{255, 190, 40},
    held_colour{90, 200, 255};

/// Pixels where the model is seen and its neighbour is not.
void draw_outline(const CameraModel& camera, const Occluder& occluder, Rgb& picture) {
  const double scale = static_cast<double>(camera.width) / picture.width;
  const auto seen = [&](int x, int y) {
    const double u = (x + 0.5) * scale - 0.5, v = (y + 0.5) * scale - 0.5;
    return occluder.first_hit(ray_through(camera, u, v)).has_value();
  };
  std::vector<std::uint8_t> above(static_cast<std::size_t>(picture.width), 0);
  for (int y = 0; y < picture.height; ++y) {
    std::uint8_t left = 0;
    for (int x = 0; x < picture.width; ++x) {
      const std::uint8_t here = seen(x, y) ? 1 : 0;
      const auto column = static_cast<std::size_t>(x);
      if ((x > 0 && here != left) || (y > 0 && here != above[column]))
        picture.set(x, y, outline_colour);
      left = here;
      above[column] = here;
    }
  }
}

void draw_ring(const Eigen::Vector2d& centre, const std::array<std::uint8_t, 3>& colour,
               Rgb& picture) {
  constexpr int steps = 64;
  for (const double radius : {5.0, 6.0}) {
    for (int i = 0; i < steps; ++i) {
      const double a = 2 * std::numbers::pi * i / steps;
      picture.set(static_cast<int>(std::lround(centre.x() + radius * std::cos(a))),
                  static_cast<int>(std::lround(centre.y() + radius * std::sin(a))), colour);
    }
  }
}

/// Letters of three by five, rows from the top, a bit for a pixel: all that a light's name needs.
int glyph(char letter) {
  constexpr std::array<int, 10> digits{075557, 026227, 071747, 071717, 055711,
                                       074717, 074757, 071111, 075757, 075717};
  if (letter >= '0' && letter <= '9') return digits[static_cast<std::size_t>(letter - '0')];
  return letter == 'L' ? 044447 : letter == 'H' ? 055755 : 0;
}

/// A light's name to the upper right of its ring, or to the left where the picture ends, dark
/// behind so that it is read on anything.
void draw_name(const std::string& name, const Eigen::Vector2d& centre,
               const std::array<std::uint8_t, 3>& colour, Rgb& picture) {
  const int size = std::max(1, picture.width / 320);
  const int width = 4 * size * static_cast<int>(name.size()) + size, height = 7 * size;
  const int ring = static_cast<int>(std::lround(centre.x()));
  const int left = ring + 6 + width < picture.width ? ring + 6 : ring - 6 - width;
  const int top = std::max(0, static_cast<int>(std::lround(centre.y())) - 6 - height);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const int column = x / size - 1, row = y / size - 1;
      const bool inside = column >= 0 && column % 4 < 3 && row >= 0 && row < 5;
      const bool on = inside && (glyph(name[static_cast<std::size_t>(column / 4)]) >>
                                     (3 * (4 - row) + 2 - column % 4) &
                                 1) != 0;
      picture.set(left + x, top + y, on ? colour : std::array<std::uint8_t, 3>{20, 20, 20});
    }
}

/// Whether a shot is planned at this turn of the object; true without a turntable.
bool turned_so(const GantryModel& gantry, const Shot& shot, const GantryPosition& at) {
  constexpr double half_a_degree = std::numbers::pi / 360;
  if (!turns_object(gantry)) return true;
  return std::abs(std::remainder(shot.gantry.axes[0] - at.axes[0], 2 * std::numbers::pi)) <=
         half_a_degree;
}

}  // namespace

ExpectedHighlights expected_highlights(const Rig& rig, const Prepared& prepared,
                                       const GantryPosition& position) {
  const CameraModel camera = camera_at(rig.gantry.model, rig.camera.model, position);
  ExpectedHighlights highlights;
  for (int s = 0; s < static_cast<int>(prepared.plan.shots.size()); ++s) {
    const Shot& shot = prepared.plan.shots[static_cast<std::size_t>(s)];
    if (!turned_so(rig.gantry.model, shot, position)) {
      highlights.at_another_turn.push_back(s);
      continue;
    }
    const SurfacePoints& points = points_of_shot(prepared, s);
    ExpectedHighlight best;
    best.shot = s;
    best.off = std::numeric_limits<double>::infinity();
    Eigen::Index at = -1;
    for (Eigen::Index i = 0; i < points.size(); ++i) {
      const Eigen::Vector3d x = points.position.col(i), n = points.normal.col(i);
      const Eigen::Vector3d l = shot.light.direction_from(x), v = points.view.col(i);
      if (!(n.dot(l) > 0) || (l + v).squaredNorm() < 1e-12 || !shot.light.reaches(x)) continue;
      const double off = std::acos(std::clamp(n.dot((l + v).normalized()), -1.0, 1.0));
      if (off < best.off && !prepared.occluder->blocked(x, n, shot.light)) {
        best.off = off;
        at = i;
      }
    }
    if (at < 0) {
      highlights.lights_nothing.push_back(s);
      continue;
    }
    best.pixel = project(camera, points.position.col(at));
    highlights.seen.push_back(best);
  }
  return highlights;
}

Result<std::vector<std::byte>> overlay_png(const std::string& png, const Rig& rig,
                                           const Prepared& prepared, const GantryPosition& at) {
  auto picture = decoded(png);
  if (!picture) return tl::unexpected(picture.error());
  const CameraModel camera = camera_at(rig.gantry.model, rig.camera.model, at);
  const double scale = static_cast<double>(camera.width) / picture->width;
  if (std::abs(picture->height * scale - camera.height) > scale + 1)
    return fail(
        ErrorCode::invalid_input,
        fmt::format("draw over the picture: it is {} × {} px, the rig file's camera takes {} "
                    "× {}: give the rig file that the service runs",
                    picture->width, picture->height, camera.width, camera.height));
  // Names first: neither the outline nor a ring is hidden by one.
  const std::vector<ExpectedHighlight> seen = expected_highlights(rig, prepared, at).seen;
  const auto each = [&](auto&& draw) {
    for (const ExpectedHighlight& one : seen) {
      const bool held = prepared.plan.shots[static_cast<std::size_t>(one.shot)].held_out;
      draw(one.shot, Eigen::Vector2d((one.pixel.array() + 0.5) / scale - 0.5),
           held ? held_colour : ring_colour);
    }
  };
  each([&](int shot, const Eigen::Vector2d& centre, const auto& colour) {
    draw_name(shot_name(prepared.plan, shot), centre, colour, *picture);
  });
  draw_outline(camera, *prepared.occluder, *picture);
  each([&](int, const Eigen::Vector2d& centre, const auto& colour) {
    draw_ring(centre, colour, *picture);
  });
  return encode_png(picture->width, picture->height, 3, picture->pixels);
}

Result<PoseFit> pose_in_preview(const std::string& png, const Rig& rig, const Prepared& prepared,
                                const GantryPosition& at) {
  const auto picture = decoded(png);
  if (!picture) return tl::unexpected(picture.error());
  CameraModel camera = camera_at(rig.gantry.model, rig.camera.model, at);
  // A pixel of the preview shows one green site of a mosaic out of so many, not their mean.
  const ColorFilter filter = rig.camera.sensor.filter;
  const int step = camera.width / picture->width;
  const int column = filter != ColorFilter::mono && channel_at(filter, 0, 0) != 1 ? 1 : 0;
  camera.width = picture->width;
  camera.height = picture->height;
  camera.fx /= step;
  camera.fy /= step;
  camera.cx = (camera.cx - column) / step;
  camera.cy /= step;
  if (extent_in_picture(prepared.object.mesh, camera) < least_pose_pixels) return PoseFit{};
  LitPicture lit{picture->width, picture->height, {}, {}};
  for (std::size_t i = 0; i < picture->pixels.size(); i += 3) {
    const double tone = picture->pixels[i + 1] / 255.0;
    const bool white = picture->pixels[i] == 255 && tone == 0;  // drawn red
    // Tones are rounded, and what they are of is gamma-coded.
    const double grain = 2.2 * std::pow(tone + 0.5 / 255, 1.2) / 255;
    lit.value.push_back(static_cast<float>(std::pow(tone, 2.2)));
    lit.variance.push_back(white ? std::numeric_limits<float>::infinity()
                                 : static_cast<float>(grain * grain + 1e-8));
  }
  return fit_pose(lit, prepared.object.mesh, *prepared.occluder, camera,
                  light_at(rig.gantry.model, at), 1);
}

}  // namespace lightrig
