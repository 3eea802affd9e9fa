#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/brdf_error.h"
#include "core/fit.h"
#include "core/samples.h"
#include "daemon/session/curve_point.h"
#include "daemon/session/patience.h"
#include "daemon/session/prepare.h"
#include "daemon/session/session_folder.h"

namespace lightrig {

struct ImageSites;

/// A BRDF that counts as the truth.
struct Reference {
  std::string name;
  BrdfTable table;
  bool simulated = false;  ///< the simulator's own material
};

/// The truth of a session, as far as there is one: the reference file the session names, or the
/// simulator's material when `simulated`. Empty where nothing is known. A mono camera sees the mean
/// of the channels. Errors: those of reading the file or finding the material.
Result<std::optional<Reference>> reference_of(const Rig& rig, const SessionSpec& spec,
                                              bool simulated);

/// What a reduction does besides its arithmetic.
struct ReductionOptions {
  int threads = 1;
  std::optional<Reference> reference = {};  ///< curve points state the true error against it
  std::filesystem::path radiance = {};      ///< folder for merged radiance images; "" writes none
  bool pictures = false;                    ///< keep what the pictures of a report are made from
  Patience patience = {};  ///< told of each frame read, merge, extraction and fit; stopped, add()
                           ///< says so, and estimate() by trouble()
};

/// One shot's way to samples, as far as reports need it.
struct ReducedShot {
  CapturedShot shot;
  LightPosition light;
  Eigen::Array3d strength = Eigen::Array3d::Ones();  ///< of the lamp as lit, per channel
  /// With ReductionOptions::pictures: radiance less ambient at every picture site (image_sites.h).
  std::vector<float> site_radiance;
};

/// Frames → radiance → samples → BRDF, one shot at a time; the same code alongside a capture and
/// from a folder alone. Deterministic: the same frames give the same numbers whatever the number of
/// threads. Rig, spec and prepared must outlive it.
class Reduction {
 public:
  Reduction(const Rig& rig, const SessionSpec& spec, const Prepared& prepared, SessionFolder folder,
            std::vector<StoredFrame> darks, ReductionOptions options);
  Reduction(const Rig& rig, const SessionSpec& spec, const Prepared& prepared, SessionFolder folder,
            std::vector<StoredFrame> darks, int threads);
  ~Reduction();
  Reduction(Reduction&&) noexcept;
  Reduction& operator=(Reduction&&) noexcept;

  /// Merges and extracts one captured shot. Errors: those of reading frames and merging, and
  /// stopped; the shot then counts as never added.
  Result<void> add(const CapturedShot& shot);

  /// Fit over all fitted lights added so far. The held-out figure is there once a held-out light
  /// was added.
  CurvePoint estimate();
  /// Why an estimate() could not look at a shot again whose pixels it doubted: a frame that was
  /// read before cannot be any more; or that it was stopped. What it returned then stands on less
  /// than it should, or is empty, and so is every later one.
  const std::optional<Error>& trouble() const;

  /// Observations added so far, in order of addition; refined by the last estimate() [refine.h].
  const std::vector<BrdfObservations>& observations() const;
  /// The same shots, in the same order.
  const std::vector<ReducedShot>& shots() const;

  /// The basis the fit uses: the prepared one, or its first 45 components for the pseudo-inverse;
  /// its model_sigma is what the last estimate() found in the data (core/adaptive_fit.h).
  const BrdfBasis& basis() const;
  /// The model_sigma that the basis came with.
  double expected_sigma() const;
  /// Of the last estimate().
  const Coefficients& coefficients() const;
  const Reconstruction& reconstruction() const;

  /// The sites of shots()[shot].site_radiance; null before the first shot or without pictures.
  const ImageSites* image_sites(std::size_t shot) const;

  /// Seconds spent so far on reading, merging, extracting, fitting and storing radiance.
  std::vector<StageCost> cost() const;

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
                                                      ///< simulated from the truth, estimated as
                                                      ///< published (pseudo-inverse)
  std::optional<double> random_lights_map_error_percent;  ///< the same lights by MAP
  std::vector<StageCost> cost;
  std::filesystem::path result;  ///< folder written
};

/// Reduces a whole session folder and writes radiance/ and result/ (brdf.binary, coefficients.json,
/// uncertainty, result.json, PNGs, report.html) under `out` ("": the folder itself). The report's
/// sphere stands in the light of the picture `environment` ("": a studio). Errors: those of reading
/// the folder and the picture; invalid_input when the folder holds no light to fit; no_space,
/// refused; stopped, once the shot or stage in hand is over: then result/ is as it was. Beats with
/// every frame, shot, fit, random light and picture; `told`, where there is one, gets each point of
/// the curve as it becomes known.
Result<ReductionSummary> reduce_session(const std::filesystem::path& session,
                                        const std::filesystem::path& out, int threads,
                                        const std::filesystem::path& environment = {},
                                        const Patience& patience = {},
                                        const std::function<void(const CurvePoint&)>& told = {});

}  // namespace lightrig
