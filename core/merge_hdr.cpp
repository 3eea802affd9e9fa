#include "core/merge_hdr.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <thread>

#include "core/check.h"
#include "core/planner_kernels.h"

namespace lightrig {
namespace {

/// Sites are worked through in blocks whose whole scratch stays in the first-level cache.
constexpr std::size_t block = 512;
constexpr std::size_t most_frames = 32;

/// One exposure of the bracket, in electrons.
struct Exposure {
  const std::uint16_t* counts = nullptr;
  const float* offset_counts = nullptr;  ///< (sites) [DN] mean of the dark frames, or nullptr
  float offset = 0;                      ///< [DN] black level and dark current, without dark frames
  float t = 0;                           ///< [s]
  float fixed_variance = 0;  ///< [e⁻²] all but the shot noise of the signal: read noise,
                             ///< quantisation, shot noise of the dark current, dark frame's own
};

Result<void> check_frames(std::span<const Frame> frames, const char* what, int width, int height) {
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const Frame& frame = frames[i];
    const auto sites = static_cast<std::size_t>(std::max(width, 0)) *
                       static_cast<std::size_t>(std::max(height, 0));
    if (frame.counts.width != width || frame.counts.height != height ||
        frame.counts.counts.size() != sites || sites == 0) {
      return fail(ErrorCode::invalid_input,
                  fmt::format("merging a bracket: {} frame {} is {} × {} with {} counts, the first "
                              "of the bracket {} × {}; frames of one shot must be of one size",
                              what, i, frame.counts.width, frame.counts.height,
                              frame.counts.counts.size(), width, height));
    }
    if (!(frame.exposure > 0) || !std::isfinite(frame.exposure)) {
      return fail(ErrorCode::invalid_input,
                  fmt::format("merging a bracket: {} frame {} says it was exposed for {} s; the "
                              "exposure as applied must be positive",
                              what, i, frame.exposure));
    }
  }
  return {};
}

/// Mean of the dark frames taken at one exposure time.
struct DarkMean {
  double exposure = 0;
  int frames = 0;
  std::vector<float> counts;  ///< (sites) [DN]
};

/// Dark frames whose time equals one of the bracket's, averaged per time.
std::vector<DarkMean> dark_means(std::span<const Frame> bracket, std::span<const Frame> dark) {
  std::vector<DarkMean> means;
  for (const Frame& frame : dark) {
    // An exposure read back from a camera differs from its twin in the last digits only.
    const auto same = [&](double t) { return std::abs(t - frame.exposure) <= 1e-4 * t; };
    if (std::none_of(bracket.begin(), bracket.end(),
                     [&](const Frame& f) { return same(f.exposure); })) {
      continue;
    }
    auto mean = std::find_if(means.begin(), means.end(),
                             [&](const DarkMean& m) { return same(m.exposure); });
    if (mean == means.end()) {
      means.push_back({frame.exposure, 0, std::vector<float>(frame.counts.counts.size(), 0.0F)});
      mean = means.end() - 1;
    }
    ++mean->frames;
    for (std::size_t i = 0; i < mean->counts.size(); ++i) {
      mean->counts[i] += static_cast<float>(frame.counts.counts[i]);
    }
  }
  for (DarkMean& mean : means) {
    for (float& value : mean.counts) value /= static_cast<float>(mean.frames);
  }
  return means;
}

std::vector<Exposure> describe(std::span<const Frame> bracket, const std::vector<DarkMean>& darks,
                               const SensorModel& sensor) {
  std::vector<Exposure> out;
  for (const Frame& frame : bracket) {
    const double dark_electrons = sensor.dark_current * frame.exposure;
    const double once =
        sensor.read_noise * sensor.read_noise + sensor.gain * sensor.gain / 12 + dark_electrons;
    Exposure e;
    e.counts = frame.counts.counts.data();
    e.t = static_cast<float>(frame.exposure);
    e.offset = static_cast<float>(sensor.black_level + dark_electrons / sensor.gain);
    e.fixed_variance = static_cast<float>(once);
    for (const DarkMean& mean : darks) {
      if (std::abs(mean.exposure - frame.exposure) <= 1e-4 * mean.exposure) {
        e.offset_counts = mean.counts.data();
        e.fixed_variance = static_cast<float>(once * (1 + 1.0 / mean.frames));
      }
    }
    out.push_back(e);
  }
  return out;
}

/// Counts from which on a site is full: white level or full well, less the margin.
float saturation_counts(const SensorModel& sensor, double margin) {
  double limit = sensor.white_level() * (1 - margin);
  if (sensor.full_well > 0) {
    limit = std::min(limit, sensor.black_level + sensor.full_well * (1 - margin) / sensor.gain);
  }
  return static_cast<float>(limit);
}

struct Merger {
  std::vector<Exposure> exposures;
  const SensorModel* sensor = nullptr;
  const MergeOptions* options = nullptr;
  float full_counts = 0;
  float shortest = 0;  ///< [s]
  RadianceImage* image = nullptr;

  int level = 2;  ///< of the processor
  /// (2)(width) [W m⁻² sr⁻¹ s/e⁻] of even and odd rows: a filter repeats every two.
  std::array<std::vector<float>, 2> response_rows = {};

  void merge_block(std::size_t first, std::size_t n, const float* per_electron) const;
};

constexpr std::int32_t site_number(RadianceImage::Site site) {
  return static_cast<std::int32_t>(site);
}

/// Maximum likelihood of the electron rate φ [e⁻/s] of each site: Σ t x/v(φ) / Σ t²/v(φ) with
/// v(φ) = φt + σ², re-weighted from its own estimate. Because the weights follow the common φ and
/// never a frame's own count, the estimating equation has no bias.
[[gnu::always_inline]] inline void merge_body(const Merger& merger, std::size_t first,
                                              std::size_t n, const float* per_electron) {
  const std::vector<Exposure>& exposures = merger.exposures;
  const SensorModel* sensor = merger.sensor;
  const MergeOptions* options = merger.options;
  RadianceImage* image = merger.image;
  const float full_counts = merger.full_counts, shortest = merger.shortest;
  const std::size_t frames = exposures.size();
  const std::size_t next = std::min(block, image->L.size() - first - n);  // sites after these
  const auto gain = static_cast<float>(sensor->gain);
  alignas(64) float x[most_frames][block];  // [e⁻]
  alignas(64) float use[most_frames][block];
  alignas(64) float rate[block], information[block], usable[block];
  for (std::size_t i = 0; i < n; ++i) rate[i] = information[i] = usable[i] = 0;
  for (std::size_t e = 0; e < frames; ++e) {
    const Exposure& exposure = exposures[e];
    const std::uint16_t* counts = exposure.counts + first;
    for (std::size_t i = 0; i < n; ++i) {
      const auto count = static_cast<float>(counts[i]);
      use[e][i] = count < full_counts ? 1.0F : 0.0F;
      x[e][i] = (count - exposure.offset) * gain;
    }
    if (exposure.offset_counts != nullptr) {
      const float* offset = exposure.offset_counts + first;
      for (std::size_t i = 0; i < n; ++i) {
        x[e][i] = (static_cast<float>(counts[i]) - offset[i]) * gain;
      }
    }
    for (std::size_t i = 0; i < n; ++i) {
      rate[i] += use[e][i] * x[e][i];
      usable[i] += use[e][i] * exposure.t;
    }
    // What the next block asks for comes near while this one is worked on.
    for (std::size_t i = 0; i < next; i += 32) __builtin_prefetch(counts + n + i);
  }
  for (std::size_t i = 0; i < n; ++i) rate[i] /= std::max(usable[i], 1e-30F);
  for (int round = 0; round < options->rounds; ++round) {
    alignas(64) float numerator[block];
    for (std::size_t i = 0; i < n; ++i) numerator[i] = information[i] = 0;
    for (std::size_t e = 0; e < frames; ++e) {
      const float t = exposures[e].t, fixed = exposures[e].fixed_variance;
      for (std::size_t i = 0; i < n; ++i) {
        const float w = use[e][i] * t / (std::max(rate[i], 0.0F) * t + fixed);
        numerator[i] += w * x[e][i];
        information[i] += w * t;
      }
    }
    for (std::size_t i = 0; i < n; ++i) rate[i] = numerator[i] / std::max(information[i], 1e-30F);
  }
  const auto detection = static_cast<float>(options->detection_sigma);
  float* __restrict__ L = image->L.data() + first;
  float* __restrict__ variance = image->variance.data() + first;
  RadianceImage::Site* __restrict__ site = image->site.data() + first;
  // Saturated everywhere: the full site at the shortest exposure is what is known, from below.
  const auto least_full = static_cast<float>((double{full_counts} - sensor->black_level) *
                                             sensor->gain / double{shortest});
  // One choice to a loop: whole vectors go through then, as above.
  alignas(64) std::int32_t what[block];
  for (std::size_t i = 0; i < n; ++i) {
    const float v = 1 / std::max(information[i], 1e-30F);
    information[i] = v * per_electron[i] * per_electron[i];
    what[i] = rate[i] < detection * std::sqrt(v) ? site_number(RadianceImage::Site::dark)
                                                 : site_number(RadianceImage::Site::measured);
  }
  for (std::size_t i = 0; i < n; ++i) {
    L[i] = (usable[i] > 0 ? rate[i] : least_full) * per_electron[i];
  }
  for (std::size_t i = 0; i < n; ++i) {
    variance[i] = usable[i] > 0 ? information[i] : std::numeric_limits<float>::infinity();
  }
  for (std::size_t i = 0; i < n; ++i) {
    what[i] = usable[i] > 0 ? what[i] : site_number(RadianceImage::Site::saturated);
  }
  for (std::size_t i = 0; i < n; ++i) site[i] = static_cast<RadianceImage::Site>(what[i]);
}

// One rounding per operation on any processor: the same bits from each of these.
#if defined(__x86_64__)
[[gnu::target("arch=x86-64-v4,prefer-vector-width=512")]] void merge_v4(const Merger& merger,
                                                                        std::size_t first,
                                                                        std::size_t n,
                                                                        const float* per_electron) {
  merge_body(merger, first, n, per_electron);
}
[[gnu::target("arch=x86-64-v3")]] void merge_v3(const Merger& merger, std::size_t first,
                                                std::size_t n, const float* per_electron) {
  merge_body(merger, first, n, per_electron);
}
#endif

void Merger::merge_block(std::size_t first, std::size_t n, const float* per_electron) const {
#if defined(__x86_64__)
  if (level >= 4) return merge_v4(*this, first, n, per_electron);
  if (level == 3) return merge_v3(*this, first, n, per_electron);
#endif
  merge_body(*this, first, n, per_electron);
}

/// Sites [first, last) say nothing.
void leave_unknown(RadianceImage& image, std::size_t first, std::size_t last) {
  const auto from = static_cast<std::ptrdiff_t>(first), to = static_cast<std::ptrdiff_t>(last);
  std::fill(image.variance.begin() + from, image.variance.begin() + to,
            std::numeric_limits<float>::infinity());
  std::fill(image.site.begin() + from, image.site.begin() + to, RadianceImage::Site::saturated);
}

/// Runs rows [begin, end) of the image in blocks.
void merge_rows(const Merger& merger, int begin, int end) {
  RadianceImage& image = *merger.image;
  const RowSpans* spans = merger.options->spans;
  for (int row = begin; row < end; ++row) {
    const std::vector<float>& per_electron =
        merger.response_rows[static_cast<std::size_t>(row % 2)];
    const auto width = static_cast<std::size_t>(image.width);
    std::size_t first = 0, last = width;
    if (spans != nullptr) {
      const auto r = static_cast<std::size_t>(row);
      first = static_cast<std::size_t>(spans->begin[r]);
      last = static_cast<std::size_t>(spans->end[r]);
      leave_unknown(image, r * width, r * width + first);
      leave_unknown(image, r * width + last, (r + 1) * width);
    }
    for (std::size_t column = first; column < last; column += block) {
      const std::size_t n = std::min(block, last - column);
      merger.merge_block(static_cast<std::size_t>(row) * width + column, n,
                         per_electron.data() + column);
    }
  }
}

Result<void> check_sensor(const SensorModel& sensor) {
  const bool sound = sensor.gain > 0 && sensor.read_noise >= 0 && sensor.dark_current >= 0 &&
                     sensor.bits >= 1 && sensor.bits <= 16 &&
                     (sensor.response.head(sensor.channels()) > 0).all();
  if (sound) return {};
  return fail(ErrorCode::invalid_input,
              fmt::format("merging a bracket: the sensor's gain {} e/DN and response must be "
                          "positive, read noise {} e and dark current {} e/s not negative, bits {} "
                          "in 1 … 16; correct [camera]",
                          sensor.gain, sensor.read_noise, sensor.dark_current, sensor.bits));
}

}  // namespace

RowSpans spans_of_sites(std::span<const std::int32_t> sites, int width, int height) {
  RowSpans spans{std::vector<std::int32_t>(static_cast<std::size_t>(height), width),
                 std::vector<std::int32_t>(static_cast<std::size_t>(height), 0)};
  // Points mostly follow the rows: then a whole run lies in one, and its ends are enough.
  constexpr std::size_t run = 128;
  const auto widen = [&](std::int32_t least, std::int32_t most) {
    const std::int32_t from = least / width * width;
    const auto r = static_cast<std::size_t>(least / width);
    if (most >= from + width) return false;
    spans.begin[r] = std::min(spans.begin[r], least - from);
    spans.end[r] = std::max(spans.end[r], most - from + 1);
    return true;
  };
  for (std::size_t i = 0; i < sites.size(); i += run) {
    const std::span<const std::int32_t> some = sites.subspan(i, std::min(run, sites.size() - i));
    std::int32_t least = some[0], most = some[0];
    for (const std::int32_t site : some) {
      least = std::min(least, site);
      most = std::max(most, site);
    }
    if (widen(least, most)) continue;
    for (const std::int32_t site : some) widen(site, site);
  }
  for (std::size_t r = 0; r < spans.begin.size(); ++r) {
    spans.begin[r] = std::min(spans.begin[r], spans.end[r]);
  }
  return spans;
}

Result<RadianceImage> merge_hdr(std::span<const Frame> bracket, std::span<const Frame> dark,
                                const SensorModel& sensor, const MergeOptions& options) {
  CHECK(options.rounds >= 1 && options.threads >= 1);
  CHECK(options.spans == nullptr || bracket.empty() ||
        options.spans->begin.size() == static_cast<std::size_t>(bracket[0].counts.height));
  if (bracket.empty() || bracket.size() > most_frames) {
    return fail(ErrorCode::invalid_input,
                fmt::format("merging a bracket: {} frames given, 1 to {} expected", bracket.size(),
                            most_frames));
  }
  const int width = bracket[0].counts.width, height = bracket[0].counts.height;
  for (const Result<void>& sound :
       {check_frames(bracket, "bracket", width, height), check_frames(dark, "dark", width, height),
        check_sensor(sensor)}) {
    if (!sound) return tl::unexpected(sound.error());
  }
  const std::size_t sites = bracket[0].counts.counts.size();
  RadianceImage image{width, height, sensor.filter, {}, {}, {}};
  image.L.resize(sites);
  image.variance.resize(sites);
  image.site.resize(sites);

  const std::vector<DarkMean> darks = dark_means(bracket, dark);
  Merger merger{describe(bracket, darks, sensor), &sensor, &options, 0, 0, &image};
  merger.level = vector_level();
  for (int row = 0; row < 2; ++row) {
    for (int column = 0; column < width; ++column) {
      const int channel = channel_at(sensor.filter, row, column);
      merger.response_rows[static_cast<std::size_t>(row)].push_back(
          static_cast<float>(1 / sensor.response[channel]));
    }
  }
  merger.full_counts = saturation_counts(sensor, options.saturation_margin);
  merger.shortest = std::min_element(merger.exposures.begin(), merger.exposures.end(),
                                     [](const Exposure& a, const Exposure& b) { return a.t < b.t; })
                        ->t;
  // A sensor without any noise floor would divide by zero where the signal is zero.
  for (Exposure& e : merger.exposures) e.fixed_variance = std::max(e.fixed_variance, 1e-6F);

  const int threads = std::clamp(options.threads, 1, height);
  std::vector<std::jthread> others;
  for (int i = 1; i < threads; ++i) {
    others.emplace_back([&merger, height, threads, i] {
      merge_rows(merger, height * i / threads, height * (i + 1) / threads);
    });
  }
  merge_rows(merger, 0, height / threads);
  others.clear();
  return image;
}

}  // namespace lightrig
