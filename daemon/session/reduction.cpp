#include "daemon/session/reduction.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <iterator>
#include <thread>
#include <utility>

#include "core/check.h"
#include "core/extract_demosaiced.h"
#include "core/merge_hdr.h"
#include "core/pixel_neighbours.h"
#include "core/refine.h"
#include "daemon/session/black_pixels.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/frame_file.h"
#include "daemon/session/held_out.h"
#include "daemon/session/image_sites.h"
#include "daemon/session/stopwatch.h"

namespace lightrig {
namespace {

// The published estimator has no prior: with all components it would chase noise [Ali 2013].
constexpr Eigen::Index pseudo_inverse_components = 45;
constexpr int picture_pixels = 300;
// Sites of a row whose footprints are kept: enough for a mean over a cell's width.
constexpr int footprints_per_row = 24;

bool is_data(const StoredFrame& frame) {
  return frame.role == "bracket" || frame.role == "metering";
}

// A frame as the journal names it: by its bytes, so that no other file can stand in for it.
Result<Frame> read_journaled(const SessionFolder& folder, const StoredFrame& stored) {
  const std::filesystem::path path = folder.root / stored.file;
  const auto bytes = read_file(path);
  if (!bytes) return tl::unexpected(bytes.error());
  if (sha256_hex(*bytes) != stored.sha256) {
    return fail(ErrorCode::invalid_input,
                fmt::format("read frame '{}': these are not the bytes that the journal sealed: "
                            "restore the file or retake the shot",
                            stored.file));
  }
  auto frame = read_frame(path);
  // The journal holds the exposure as applied.
  if (frame && std::abs(frame->exposure - stored.exposure) > 1e-6 * stored.exposure) {
    return fail(ErrorCode::invalid_input,
                fmt::format("read frame '{}': it was exposed for {} s, the journal says {} s: "
                            "restore the file or retake the shot",
                            stored.file, frame->exposure, stored.exposure));
  }
  return frame;
}

// The files named, in order; `threads` files are decoded at a time.
Result<std::vector<Frame>> read_frames(const SessionFolder& folder,
                                       const std::vector<StoredFrame>& stored, int threads,
                                       const Patience& patience) {
  std::vector<Result<Frame>> read(stored.size(), fail(ErrorCode::stopped, "stopped on request"));
  const auto read_some = [&](std::size_t first, std::size_t stride) {
    for (std::size_t i = first; i < stored.size(); i += stride) {
      if (patience.stop.stop_requested()) return;
      read[i] = read_journaled(folder, stored[i]);
      patience.tell();
    }
  };
  const auto stride = static_cast<std::size_t>(std::max(1, threads));
  {
    std::vector<std::jthread> workers;
    for (std::size_t t = 1; t < std::min(stride, stored.size()); ++t) {
      workers.emplace_back(read_some, t, stride);
    }
    read_some(0, stride);
  }
  std::vector<Frame> frames;
  frames.reserve(stored.size());
  for (std::size_t i = 0; i < stored.size(); ++i) {
    if (!read[i]) return tl::unexpected(read[i].error());
    frames.push_back(std::move(*read[i]));
  }
  return frames;
}

Result<void> write_radiance(const std::filesystem::path& folder, const std::string& name,
                            const RadianceImage& image) {
  std::vector<float> pixels;
  pixels.reserve(3 * image.L.size());
  for (std::size_t i = 0; i < image.L.size(); ++i) {
    pixels.push_back(image.L[i]);
    pixels.push_back(static_cast<float>(image.site[i]));
    pixels.push_back(image.variance[i]);
  }
  const auto bytes = encode_float_exr(image.width, image.height, {"L", "site", "variance"}, pixels);
  if (!bytes) return tl::unexpected(bytes.error());
  return write_durably(folder / (name + ".exr"), *bytes);
}

/// A shot's radiance with the lamp and without.
struct Radiances {
  RadianceImage image;
  std::optional<RadianceImage> ambient;
};

}  // namespace

struct Reduction::State {
  const Rig* rig = nullptr;
  const SessionSpec* spec = nullptr;
  const Prepared* prepared = nullptr;
  SessionFolder folder;
  std::vector<StoredFrame> stored_darks;
  ReductionOptions options;

  BrdfBasis basis;            ///< the fit's; its model error is what the data showed
  double expected_sigma = 0;  ///< model error before any data, mapped units
  Eigen::ArrayXXd least_f;    ///< (cells × 1) [1/sr] of any material of the basis, 0: unknown
  std::optional<std::vector<Frame>> darks;
  std::optional<RowSpans> spans;  ///< of the object in the picture, where it looks always alike
  std::vector<ImageSites> sites;  ///< one; on a turntable one per shot
  std::optional<PixelNeighbours>
      neighbours;                          ///< of the shot in hand, or of all where all look alike
  std::vector<BrdfObservations> measured;  ///< as extracted
  std::vector<BrdfObservations> observations;  ///< refined by the last estimate
  std::vector<ReducedShot> shots;
  Coefficients coefficients;
  Reconstruction reconstruction;
  std::vector<StageCost> cost;
  std::optional<Error> trouble;

  void tell() const { options.patience.tell(); }
  Result<void> go_on() const {
    if (options.patience.stop.stop_requested())
      return fail(ErrorCode::stopped, "stopped on request");
    return {};
  }
  Result<RadianceImage> merge(const std::vector<StoredFrame>& stored);
  void extract_shot(const CapturedShot& shot, const RadianceImage& image,
                    const RadianceImage* ambient);
  BrdfObservations observed(int shot, const Eigen::Array3d& strength, const RadianceImage& image,
                            const RadianceImage* ambient, const Eigen::ArrayXXd& least);
  std::vector<BrdfObservations> chosen(const std::vector<BrdfObservations>& from,
                                       bool held_out) const;
  Result<Radiances> merge_shot(const CapturedShot& shot);
  std::size_t fit_to(const std::vector<BrdfObservations>& extracted);
  void look_again(std::vector<BrdfObservations>& extracted);
};

// Reads and merges frames of one kind; the darks are read once, when first needed.
Result<RadianceImage> Reduction::State::merge(const std::vector<StoredFrame>& stored) {
  Stopwatch reading("read frames", cost);
  if (!darks) {
    auto read = read_frames(folder, stored_darks, options.threads, options.patience);
    if (!read) return tl::unexpected(with_context("dark frames", read.error()));
    darks = std::move(*read);
  }
  const auto frames = read_frames(folder, stored, options.threads, options.patience);
  if (!frames) return tl::unexpected(frames.error());
  reading.stop();
  Stopwatch merging("merge", cost);
  MergeOptions merge_options;
  merge_options.threads = options.threads;
  // Pictures and stored radiance show all of the image; samples are of the object alone.
  if (spans && !options.pictures && options.radiance.empty() && !rig->camera.demosaic) {
    merge_options.spans = &*spans;
  }
  return merge_hdr(*frames, *darks, rig->camera.sensor, merge_options);
}

// A shot with the lamp and, where frames of it were taken, without.
Result<Radiances> Reduction::State::merge_shot(const CapturedShot& shot) {
  std::vector<StoredFrame> bracket, ambient_frames;
  std::ranges::copy_if(shot.frames, std::back_inserter(bracket), is_data);
  std::ranges::copy_if(shot.frames, std::back_inserter(ambient_frames),
                       [](const StoredFrame& f) { return f.role == "ambient"; });
  auto image = merge(bracket);
  if (!image) return tl::unexpected(image.error());
  tell();
  Radiances out{std::move(*image), std::nullopt};
  if (ambient_frames.empty()) return out;
  auto ambient = merge(ambient_frames);
  if (!ambient) return tl::unexpected(with_context("ambient", ambient.error()));
  out.ambient = std::move(*ambient);
  return out;
}

BrdfObservations Reduction::State::observed(int shot, const Eigen::Array3d& strength,
                                            const RadianceImage& image,
                                            const RadianceImage* ambient,
                                            const Eigen::ArrayXXd& least) {
  const Stopwatch extracting("extract", cost);
  ExtractOptions extraction;
  extraction.limits = spec->plan.limits;
  extraction.lamp_strength = strength;
  extraction.threads = options.threads;
  const GantryModel& gantry = rig->gantry.model;
  const Shot& planned = prepared->plan.shots[static_cast<std::size_t>(shot)];
  const CameraModel camera = camera_at(gantry, rig->camera.model, planned.gantry);
  const SurfacePoints& points = points_of_shot(*prepared, shot);
  if (points.from_pixels && (!neighbours || turns_object(gantry))) {
    neighbours.emplace(points, image.width, image.height);
  }
  extraction.neighbours = neighbours ? &*neighbours : nullptr;
  extraction.least_f = &least;
  if (spec->estimator == Estimator::map) extraction.footprints = footprints_per_row;
  const auto observe = rig->camera.demosaic ? extract_demosaiced : extract;
  return observe(image, ambient, points, camera, planned.light, basis.grid, basis.valid,
                 *prepared->occluder, extraction);
}

void Reduction::State::extract_shot(const CapturedShot& shot, const RadianceImage& image,
                                    const RadianceImage* ambient) {
  ReducedShot reduced;
  reduced.shot = shot;
  const Shot& planned = prepared->plan.shots[static_cast<std::size_t>(shot.index)];
  reduced.light = planned.light;
  reduced.strength = rig->lamp.strength * shot.lamp_power;
  measured.push_back(observed(shot.index, reduced.strength, image, ambient, least_f));
  observations.push_back(measured.back());
  if (options.pictures) {
    const Stopwatch drawing("pictures", cost);
    const GantryModel& gantry = rig->gantry.model;
    if (sites.empty() || turns_object(gantry)) {
      const CameraModel camera = camera_at(gantry, rig->camera.model, planned.gantry);
      sites.push_back(lightrig::image_sites(prepared->object.mesh, *prepared->occluder, camera,
                                            rig->camera.sensor.filter, picture_pixels));
    }
    reduced.site_radiance = captured_radiance(sites.back(), image, ambient);
  }
  shots.push_back(std::move(reduced));
  tell();
}

std::vector<BrdfObservations> Reduction::State::chosen(const std::vector<BrdfObservations>& from,
                                                       bool held_out) const {
  std::vector<BrdfObservations> lights;
  for (std::size_t i = 0; i < shots.size(); ++i) {
    if (shots[i].shot.held_out == held_out) lights.push_back(from[i]);
  }
  return lights;
}

Reduction::Reduction(const Rig& rig, const SessionSpec& spec, const Prepared& prepared,
                     SessionFolder folder, std::vector<StoredFrame> darks, ReductionOptions options)
    : state_(std::make_unique<State>()) {
  CHECK(options.threads >= 1);
  state_->rig = &rig;
  state_->spec = &spec;
  state_->prepared = &prepared;
  state_->folder = std::move(folder);
  state_->stored_darks = std::move(darks);
  state_->options = std::move(options);
  state_->basis = prepared.fit_basis;
  if (spec.estimator == Estimator::pseudo_inverse &&
      prepared.fit_basis.components() > pseudo_inverse_components) {
    state_->basis = truncated(prepared.fit_basis, pseudo_inverse_components);
  }
  state_->expected_sigma = state_->basis.model_sigma;
  state_->least_f = least_shown(prepared.materials, prepared.fit_basis);
  if (prepared.points.from_pixels && prepared.turned_points.empty()) {
    const CameraModel& camera = rig.camera.model;
    state_->spans = spans_of_sites(prepared.points.source, camera.width, camera.height);
  }
}

Reduction::Reduction(const Rig& rig, const SessionSpec& spec, const Prepared& prepared,
                     SessionFolder folder, std::vector<StoredFrame> darks, int threads)
    : Reduction(rig, spec, prepared, std::move(folder), std::move(darks),
                ReductionOptions{.threads = threads}) {}

Reduction::~Reduction() = default;
Reduction::Reduction(Reduction&&) noexcept = default;
Reduction& Reduction::operator=(Reduction&&) noexcept = default;

Result<void> Reduction::add(const CapturedShot& shot) {
  State& s = *state_;
  const std::string doing = "reduce shot " + shot.name;
  if (shot.index < 0 || static_cast<std::size_t>(shot.index) >= s.prepared->plan.shots.size()) {
    return fail(ErrorCode::invalid_input, fmt::format("{}: it is light {} of a plan of {}", doing,
                                                      shot.index, s.prepared->plan.shots.size()));
  }
  auto radiances = s.merge_shot(shot);
  if (!radiances) return tl::unexpected(with_context(doing, radiances.error()));
  if (auto on = s.go_on(); !on) return tl::unexpected(with_context(doing, on.error()));
  const auto& [image, ambient] = *radiances;
  const CameraModel& camera = s.rig->camera.model;
  if (image.width != camera.width || image.height != camera.height) {
    return fail(ErrorCode::invalid_input,
                fmt::format("{}: its frames are {} × {}, the rig's camera is {} × {}", doing,
                            image.width, image.height, camera.width, camera.height));
  }
  if (!s.options.radiance.empty()) {
    Stopwatch storing("store radiance", s.cost);
    if (auto written = write_radiance(s.options.radiance, shot.name, image); !written) {
      return tl::unexpected(with_context(doing, written.error()));
    }
  }
  s.extract_shot(shot, image, ambient ? &*ambient : nullptr);
  return {};
}

// Returns how many lights were fitted.
std::size_t Reduction::State::fit_to(const std::vector<BrdfObservations>& extracted) {
  Stopwatch fitting("fit", cost);
  const std::vector<BrdfObservations> trusted = believed(extracted);
  const std::vector<BrdfObservations> fitted = chosen(trusted, false);
  FitOptions fit_options;
  fit_options.estimator = spec->estimator;
  fit_options.model_sigma = expected_sigma;
  const AzimuthModel& azimuths = prepared->azimuths;
  AdaptiveFit adapted =
      fit_refined(basis, azimuths, fitted, rig->camera.sensor.channels(), fit_options);
  coefficients = std::move(adapted.coefficients);
  basis.model_sigma = adapted.model_sigma;
  for (std::size_t i = 0; i < extracted.size(); ++i) {
    observations[i] = refined(trusted[i], basis, azimuths, coefficients);
    observations[i].footprints.clear();
  }
  fitting.stop();
  const Stopwatch reconstructing("reconstruct", cost);
  reconstruction = reconstruct(basis, coefficients);
  tell();
  return fitted.size();
}

// A bright material leaves no lit pixel black, but how bright it is only the fit tells: lights with
// black pixels that the estimate rules out are extracted again.
void Reduction::State::look_again(std::vector<BrdfObservations>& extracted) {
  const Eigen::ArrayXXd least = surely_shown(reconstruction, basis.mapping, least_f);
  for (std::size_t i = 0; i < extracted.size(); ++i) {
    if (!tells_more_blocked(extracted[i], least)) continue;
    const ReducedShot& shot = shots[i];
    const auto radiances = merge_shot(shot.shot);
    if (!radiances) {
      trouble = with_context("look again at shot " + shot.shot.name, radiances.error());
      return;
    }
    const auto& [image, ambient] = *radiances;
    extracted[i] =
        observed(shot.shot.index, shot.strength, image, ambient ? &*ambient : nullptr, least);
    tell();
  }
}

CurvePoint Reduction::estimate() {
  State& s = *state_;
  const auto stopped = [&] {
    if (auto on = s.go_on(); !on) s.trouble = on.error();
    return s.trouble.has_value();
  };
  if (stopped()) return {};
  std::vector<BrdfObservations> extracted = s.measured;
  const auto doubted = [](const BrdfObservations& light) { return !light.doubtful.empty(); };
  if (std::ranges::any_of(extracted, doubted)) {
    // What is to judge black pixels must not rest on the bounds that they set.
    std::vector<BrdfObservations> bright = extracted;
    for (BrdfObservations& light : bright)
      if (doubted(light)) light = without_dark(light);
    s.fit_to(bright);
    s.look_again(extracted);
    if (stopped()) return {};
  }
  const std::size_t lights = s.fit_to(extracted);

  CurvePoint point;
  point.lights = static_cast<int>(lights);
  for (const ReducedShot& shot : s.shots) {
    if (!shot.shot.held_out) point.elapsed_s = std::max(point.elapsed_s, shot.shot.elapsed_s);
  }
  point.predicted_error_percent = s.reconstruction.predicted_error_percent;
  point.predicted_low_percent = s.reconstruction.predicted_low_percent;
  point.predicted_high_percent = s.reconstruction.predicted_high_percent;
  const double floor = s.basis.mapping.floor;
  const std::vector<BrdfObservations> held_out = s.chosen(s.observations, true);
  if (!held_out.empty()) {
    const HeldOutError error = held_out_error(held_out, s.reconstruction, floor);
    if (error.rows > 0) point.held_out_error_percent = error.percent;
  }
  if (s.options.reference) {
    point.true_error_percent =
        brdf_error(s.reconstruction.brdf, s.options.reference->table, floor).percent_log;
  }
  return point;
}

const std::optional<Error>& Reduction::trouble() const { return state_->trouble; }
const std::vector<BrdfObservations>& Reduction::observations() const {
  return state_->observations;
}
const std::vector<ReducedShot>& Reduction::shots() const { return state_->shots; }
const BrdfBasis& Reduction::basis() const { return state_->basis; }
double Reduction::expected_sigma() const { return state_->expected_sigma; }
const Coefficients& Reduction::coefficients() const { return state_->coefficients; }
const Reconstruction& Reduction::reconstruction() const { return state_->reconstruction; }
std::vector<StageCost> Reduction::cost() const { return state_->cost; }
const ImageSites* Reduction::image_sites(std::size_t shot) const {
  const std::vector<ImageSites>& sites = state_->sites;
  if (sites.empty()) return nullptr;
  return &sites[std::min(shot, sites.size() - 1)];
}

}  // namespace lightrig
