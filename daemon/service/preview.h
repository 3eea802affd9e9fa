#pragma once

#include <array>
#include <cstdint>
#include <mutex>
#include <string>
#include <vector>

#include "core/image.h"
#include "core/result.h"

namespace lightrig {

/// The last frame, small enough to look at: offered by the session thread, encoded when asked for.
class Preview {
 public:
  static constexpr int most_columns = 640;

  /// What a histogram says of the last frame.
  struct Facts {
    std::string shot;
    double exposure = 0;  ///< [s]
    double saturated_percent = 0;
    std::array<int, 64> histogram{};  ///< sites per equal part of the range black … white
  };

  explicit Preview(const SensorModel& sensor) : sensor_(sensor) {}

  /// Takes a thinned copy; about a millisecond, never waits for a reader.
  Facts offer(const Frame& frame, const std::string& shot);

  /// The thinned copy as PNG, brightened for the eye, saturated sites red. Errors: not_found before
  /// the first frame.
  Result<std::string> png();

 private:
  struct Thumb {
    int width = 0, height = 0;
    std::vector<std::uint8_t> rgb;
  };
  Thumb thin(const Frame& frame) const;

  const SensorModel sensor_;
  std::mutex mutex_;
  Thumb thumb_;
  std::string encoded_;  ///< of `thumb_`; empty until asked for
};

}  // namespace lightrig
