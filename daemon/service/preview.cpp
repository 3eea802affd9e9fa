#include "daemon/service/preview.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "daemon/session/frame_file.h"

namespace lightrig {
namespace {

// A channel's site in the 2 × 2 block at (row, column); mono: the corner.
int site_of(const Frame& frame, ColorFilter filter, int row, int column, int channel) {
  for (int dy = 0; dy < 2; ++dy)
    for (int dx = 0; dx < 2; ++dx)
      if (filter == ColorFilter::mono || channel_at(filter, row + dy, column + dx) == channel)
        return (row + dy) * frame.counts.width + column + dx;
  return row * frame.counts.width + column;
}

}  // namespace

Preview::Thumb Preview::thin(const Frame& frame) const {
  const RawImage& raw = frame.counts;
  // Even steps keep a mosaic's blocks whole.
  const int step = std::max(2, (raw.width / most_columns + 1) / 2 * 2);
  Thumb thumb;
  thumb.width = raw.width / step;
  thumb.height = raw.height / step;
  thumb.rgb.reserve(static_cast<std::size_t>(thumb.width) * static_cast<std::size_t>(thumb.height) *
                    3);
  const double range = sensor_.white_level() - sensor_.black_level;
  for (int y = 0; y < thumb.height; ++y)
    for (int x = 0; x < thumb.width; ++x) {
      std::array<double, 3> value{};
      bool saturated = false;
      for (int channel = 0; channel < 3; ++channel) {
        const int site = site_of(frame, sensor_.filter, y * step, x * step, channel);
        const int count = raw.counts[static_cast<std::size_t>(site)];
        saturated = saturated || count >= sensor_.white_level();
        value[static_cast<std::size_t>(channel)] =
            std::clamp((count - sensor_.black_level) / range, 0.0, 1.0);
      }
      // A picture for the eye: 1/2.2 as every screen expects.
      for (double v : value)
        thumb.rgb.push_back(static_cast<std::uint8_t>(std::lround(255 * std::pow(v, 1 / 2.2))));
      if (saturated) {
        thumb.rgb.end()[-3] = 255;
        thumb.rgb.end()[-2] = thumb.rgb.end()[-1] = 0;
      }
    }
  return thumb;
}

Preview::Facts Preview::offer(const Frame& frame, const std::string& shot) {
  Thumb thumb = thin(frame);
  {
    const std::lock_guard lock(mutex_);
    thumb_ = std::move(thumb);
    encoded_.clear();
  }
  Facts facts;
  facts.shot = shot;
  facts.exposure = frame.exposure;
  const double range = sensor_.white_level() - sensor_.black_level;
  constexpr std::size_t stride = 7;  // prime to any mosaic: every colour counts alike
  std::size_t sites = 0, saturated = 0;
  for (std::size_t i = 0; i < frame.counts.counts.size(); i += stride, ++sites) {
    const int count = frame.counts.counts[i];
    if (count >= sensor_.white_level()) ++saturated;
    const double part = (count - sensor_.black_level) / range * 64;
    ++facts.histogram[static_cast<std::size_t>(std::clamp(part, 0.0, 63.0))];
  }
  if (sites > 0)
    facts.saturated_percent = 100.0 * static_cast<double>(saturated) / static_cast<double>(sites);
  return facts;
}

Result<std::string> Preview::png() {
  Thumb thumb;
  {
    const std::lock_guard lock(mutex_);
    if (!encoded_.empty()) return encoded_;
    thumb = thumb_;
  }
  if (thumb.rgb.empty())
    return fail(ErrorCode::not_found, "no frame has been taken yet; start a session");
  auto bytes = encode_png(thumb.width, thumb.height, 3, thumb.rgb);
  if (!bytes) return tl::unexpected(bytes.error());
  std::string text(bytes->size(), '\0');
  std::transform(bytes->begin(), bytes->end(), text.begin(),
                 [](std::byte b) { return static_cast<char>(b); });
  const std::lock_guard lock(mutex_);
  // A newer frame may have come meanwhile; then this encoding is only the asker's.
  if (thumb_.rgb == thumb.rgb) encoded_ = text;
  return text;
}

}  // namespace lightrig
