#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "core/brdf_error.h"
#include "core/fit.h"
#include "core/samples.h"
#include "daemon/session/prepare.h"
#include "daemon/session/session_folder.h"

namespace lightrig {

/// What was known after so many lights.
struct CurvePoint {
  int lights = 0;
  double elapsed_s = 0;  ///< measured rig time
  double predicted_error_percent = 0, predicted_low_percent = 0, predicted_high_percent = 0;
  std::optional<double>
      held_out_error_percent;  ///< image of the held-out light: predicted against captured
  std::optional<double> true_error_percent;  ///< against a known reference
};

/// Frames → radiance → samples → BRDF, one shot at a time; the same code alongside a capture and
/// from a folder alone.
class Reduction {
 public:
  Reduction(const Rig& rig, const SessionSpec& spec, const Prepared& prepared, SessionFolder folder,
            std::vector<StoredFrame> darks, int threads);
  ~Reduction();
  Reduction(Reduction&&) noexcept;

  /// Merges and extracts one captured shot. Errors: those of reading frames and merging.
  Result<void> add(const CapturedShot& shot);

  /// Fit over all fitted lights added so far.
  CurvePoint estimate();

  /// Observations added so far, in order of addition.
  const std::vector<BrdfObservations>& observations() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

struct ReductionSummary {
  std::vector<CurvePoint> curve;
  BrdfError true_error;  ///< valid when has_truth
  bool has_truth = false;
  double mean_only_error_percent =
      0;  ///< the zero line: no light at all; true where the truth is known, else predicted
  std::optional<double> random_lights_error_percent;  ///< median over seeds, as many random lights,
                                                      ///< simulated from the truth
  std::vector<StageCost> cost;
  std::filesystem::path result;  ///< folder written
};

/// Reduces a whole session folder and writes radiance/ and result/ (brdf.binary, coefficients.json,
/// uncertainty, result.json, PNGs, report.html) under `out` (default: the folder itself).
Result<ReductionSummary> reduce_session(const std::filesystem::path& session,
                                        const std::filesystem::path& out, int threads);

}  // namespace lightrig
