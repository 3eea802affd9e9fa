#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/session/session_result.h"

namespace lightrig {

/// A picture as it is stored and embedded.
struct StoredPicture {
  std::string file;  ///< name below result/; "" where there is none
  int width = 0;     ///< [CSS px] as shown
  std::vector<std::byte> png;

  bool shown() const { return !png.empty(); }
};

/// The pictures of a result, with the ranges their colours span.
struct ResultPictures {
  struct Light {
    std::string name;
    StoredPicture images;  ///< captured, re-rendered, relative difference
    StoredPicture bins;    ///< the light's cells over the grid
  };
  StoredPicture spheres;           ///< the result; beside it the reference where there is one
  StoredPicture table;             ///< ln f over the grid; beside it the reference
  StoredPicture table_difference;  ///< ln result − ln reference
  StoredPicture uncertainty;       ///< standard deviation in ln units
  StoredPicture coverage;          ///< number of lights that showed each cell
  std::vector<Light> lights;
  bool with_reference = false;
  double f_low = 0, f_high = 0;         ///< [1/sr] of `table`
  double uncertainty_high = 0;          ///< ln units
  double table_difference_range = 0;    ///< ln units, either sign
  double image_difference_range = 0.3;  ///< relative, either sign
  int coverage_high = 1;
};

/// The whole result as one HTML page that needs nothing else: no script, no other file; light and
/// dark after the reader's setting, and printable.
std::string report_html(const SessionResult& result, const ResultPictures& pictures);

/// The page's style sheet.
std::string_view report_style();

}  // namespace lightrig
