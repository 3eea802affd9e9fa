#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/image.h"
#include "core/light.h"
#include "core/mesh.h"
#include "core/occlusion.h"
#include "core/surface_points.h"
#include "daemon/session/brdf_lookup.h"
#include "daemon/session/picture.h"

namespace lightrig {

/// The sensor sites that a report's pictures are made of: on every `stride`-th row and column of
/// the part of the sensor that shows the object, gathered in square blocks that become one pixel
/// each. A Bayer block holds all colours.
struct ImageSites {
  SurfacePoints points;       ///< of the sites that see the object
  int left = 0, top = 0;      ///< [sites] first column and row of the picture; even
  int width = 0, height = 0;  ///< of the picture [blocks]
  int block = 1;              ///< [sites] edge of a block; even with a mosaic
  int stride = 1;             ///< odd with a mosaic, so that it meets every colour
  int sensor_width = 0;
  ColorFilter filter = ColorFilter::mono;

  std::size_t block_of(int site) const {
    const int row = (site / sensor_width - top) / block;
    const int column = (site % sensor_width - left) / block;
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(width) +
           static_cast<std::size_t>(column);
  }
  int channel_of(int site) const {
    return channel_at(filter, site / sensor_width, site % sensor_width);
  }
};

/// Sites for pictures of the object at most `most_pixels` wide or high.
ImageSites image_sites(const Mesh& mesh, const Occluder& occluder, const CameraModel& camera,
                       ColorFilter filter, int most_pixels);

/// Radiance less ambient at the sites [W m⁻² sr⁻¹]; saturated sites hold their lower bound.
std::vector<float> captured_radiance(const ImageSites& sites, const RadianceImage& image,
                                     const RadianceImage* ambient);

/// What a material would show at the sites under a light: f · E · cos θi, 0 in shade and shadow.
/// The result does not depend on `threads`.
std::vector<float> predicted_radiance(const ImageSites& sites, const BrdfLookup& brdf,
                                      const LightPosition& light, const Eigen::Array3d& strength,
                                      const Occluder& occluder, int threads);

/// Block means as a colour image; blocks off the object, or with too little of it to show every
/// colour, are NaN.
LinearImage block_image(const ImageSites& sites, const std::vector<float>& radiance);

/// (Σ predicted − Σ captured) / Σ captured per block; NaN off the object and where either is dark.
std::vector<float> relative_difference(const ImageSites& sites, const std::vector<float>& captured,
                                       const std::vector<float>& predicted);

}  // namespace lightrig
