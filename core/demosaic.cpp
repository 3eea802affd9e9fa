#include "core/demosaic.h"

#include <algorithm>
#include <limits>

#include "core/check.h"

namespace lightrig {
namespace {

/// The sites of a colour that a pixel's value is the mean of.
struct Mean {
  int count = 0, saturated = 0, dark = 0;
  double sum = 0, variance = 0;

  void add(const RadianceImage& image, std::size_t site) {
    ++count;
    sum += double{image.L[site]};
    saturated += image.site[site] == RadianceImage::Site::saturated;
    dark += image.site[site] == RadianceImage::Site::dark;
    variance += double{image.variance[site]};
  }
};

/// The channel's sites at distance `reach2` (squared: 0 itself, 1 beside, 2 across) of a pixel.
Mean at_distance(const RadianceImage& mosaic, int channel, int row, int column, int reach2) {
  Mean mean;
  for (int r = std::max(0, row - 1); r <= std::min(mosaic.height - 1, row + 1); ++r) {
    for (int c = std::max(0, column - 1); c <= std::min(mosaic.width - 1, column + 1); ++c) {
      const int away = (r - row) * (r - row) + (c - column) * (c - column);
      if (away != reach2 || channel_at(mosaic.filter, r, c) != channel) continue;
      mean.add(mosaic, static_cast<std::size_t>(r) * static_cast<std::size_t>(mosaic.width) +
                           static_cast<std::size_t>(c));
    }
  }
  return mean;
}

}  // namespace

RadianceImage demosaiced(const RadianceImage& mosaic, int channel) {
  CHECK(mosaic.filter != ColorFilter::mono && mosaic.width >= 2 && mosaic.height >= 2);
  RadianceImage out;
  out.width = mosaic.width;
  out.height = mosaic.height;
  const std::size_t sites = mosaic.L.size();
  out.L.reserve(sites);
  out.variance.reserve(sites);
  out.site.reserve(sites);
  for (int row = 0; row < mosaic.height; ++row) {
    for (int column = 0; column < mosaic.width; ++column) {
      Mean mean;
      for (int reach2 = 0; reach2 <= 2 && mean.count == 0; ++reach2)
        mean = at_distance(mosaic, channel, row, column, reach2);
      const bool full = mean.saturated > 0;
      out.L.push_back(static_cast<float>(mean.sum / mean.count));
      out.variance.push_back(full ? std::numeric_limits<float>::infinity()
                                  : static_cast<float>(mean.variance / (mean.count * mean.count)));
      out.site.push_back(full                      ? RadianceImage::Site::saturated
                         : mean.dark == mean.count ? RadianceImage::Site::dark
                                                   : RadianceImage::Site::measured);
    }
  }
  return out;
}

}  // namespace lightrig
