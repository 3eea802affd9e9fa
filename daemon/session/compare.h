#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "core/brdf_error.h"
#include "core/result.h"

namespace lightrig {

/// A BRDF from a MERL .binary file of any grid (reduced to the bivariate table), or from a session
/// folder's result. Errors: not_found (naming what to do for a session not yet reduced),
/// invalid_input.
Result<BrdfTable> load_brdf(const std::filesystem::path& file_or_session);

/// Two BRDFs against each other.
struct Comparison {
  BrdfError error;        ///< of a as an estimate of b
  double mean_ratio = 1;  ///< exp of the mean of ln a − ln b: one factor between the scales
  double percent_log_scaled = 0;  ///< percent_log after that factor is taken out
  std::vector<std::byte> png;     ///< spheres of both, tables of both, their difference
};

/// Compares `a` with `b`, which counts as the truth; floor [1/sr] applied to both. One-channel
/// tables are compared with the mean of the other's channels. Errors: invalid_input when the grids
/// differ or no cell is valid in both.
Result<Comparison> compare(const BrdfTable& a, const BrdfTable& b, double floor, int threads);

/// Writes the BRDF of a file or session as a full MERL file: 90 × 90 × 180 cells, φd-independent,
/// cells below the horizon marked invalid. Errors: as load_brdf; invalid_input for a grid other
/// than 90 × 90; no_space, refused.
Result<void> export_merl(const std::filesystem::path& file_or_session,
                         const std::filesystem::path& out);

struct VerifyReport {
  bool sound = false;
  std::vector<std::string> findings;  ///< one line each, what is wrong and where; empty when sound
  std::string summary;
};
/// Checks a session folder: every checksum of the manifest, the journal, every frame it names, and
/// the reduction reproduced (equal bytes, or 1e-6 relative on another build). Errors: not_found
/// where there is no session; all else is a finding.
Result<VerifyReport> verify_session(const std::filesystem::path& session, int threads);

}  // namespace lightrig
