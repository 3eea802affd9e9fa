#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "config/rig.h"
#include "core/image.h"
#include "daemon/session/prepare.h"

namespace lightrig {

/// Whether the lit frames of one shot show the lamp's light, and the same light: pictures tell what
/// a lamp that only repeats what it was told does not. Sums over the sites that the plan calls lit,
/// less the shot's own lamp-off frame, are held against each other by the ratio of their exposures,
/// and against what the darkest material of the basis would give. A difference counts only beyond
/// five standard deviations of the sensor's noise and beyond what calibration leaves open (see
/// light_witness.cpp). A frame too dark to tell either way is no contradiction: whatever it shows
/// is within its noise.
class LightWitness {
 public:
  /// `lit` as lit_sites() of the shot; `ambient`: its lamp-off frame, of the same size. What is
  /// lent must outlive it.
  LightWitness(const Rig& rig, const SessionSpec& spec, const Prepared& prepared, int shot,
               std::vector<std::uint8_t> lit, const Frame& ambient);

  /// Takes note of a lit frame, in order of exposure. What contradicts it, in words for a person
  /// ("lamp: …"); empty where nothing does. A frame that is contradicted is not taken note of.
  std::optional<std::string> contradiction(const Frame& frame);

  /// The lamp's light is beyond doubt in at least one frame so far.
  bool light_seen() const { return last_seen_.has_value(); }

  /// [s] of a further frame that would tell whether the lamp burnt to the end; empty when the last
  /// frame itself told, or none can.
  std::optional<double> closing_exposure() const;

  const std::vector<std::uint8_t>& lit() const { return lit_; }
  std::size_t sites() const { return sites_.size(); }  ///< that are lit

 private:
  /// A frame at the lit sites.
  struct View {
    double exposure = 0;  ///< [s]
    std::vector<std::uint16_t> counts;
  };
  View view_of(const Frame& frame) const;
  double above_black(std::uint16_t count) const;
  double variance(double signal, double exposure) const;
  std::optional<std::string> differs(const View& then, const View& now, bool& tells) const;
  std::optional<std::string> unlit(const View& now, bool& seen) const;
  double least_rate() const;

  const Rig& rig_;
  const SessionSpec& spec_;
  const Prepared& prepared_;
  const int shot_;
  std::vector<std::uint8_t> lit_;
  std::vector<std::uint32_t> sites_;  ///< where lit_ is 1
  double full_ = 0;                   ///< [DN] from here on a count is not believed
  View ambient_;
  std::vector<View> frames_;
  std::optional<double> last_seen_;  ///< [s] exposure of the last frame that showed light
  bool told_ = false;                ///< the last frame agreed with one that it could have denied
};

}  // namespace lightrig
