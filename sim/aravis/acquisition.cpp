#include "sim/aravis/acquisition.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>

namespace lightrig::sim {
namespace {

bool strikes(const std::vector<CameraFault>& struck, CameraFaultKind kind) {
  return std::ranges::any_of(struck, [&](const CameraFault& f) { return f.kind == kind; });
}

std::chrono::nanoseconds nanoseconds_of(double seconds) {
  return std::chrono::nanoseconds(std::llround(seconds * 1e9));
}

/// The part of the sensor that is sent, mirrored where that is asked for.
RawImage part_of(const RawImage& image, const CaptureSettings& settings, int rows) {
  RawImage out{settings.width, rows, {}};
  out.counts.reserve(static_cast<std::size_t>(out.width) * static_cast<std::size_t>(rows));
  for (int row = 0; row < rows; ++row) {
    const auto begin = image.counts.begin() +
                       static_cast<std::ptrdiff_t>(row + settings.y) * image.width + settings.x;
    const auto end = out.counts.insert(out.counts.end(), begin, begin + settings.width);
    if (settings.reverse_x) std::reverse(end, out.counts.end());
  }
  return out;
}

/// Counts of the sensor as a format carries them: cut or filled up at the low end, after gain and
/// black level, which are digital.
RawImage in_format(const RawImage& image, const CameraBody& body, const CaptureSettings& settings,
                   int rows) {
  const PixelFormat& format = *settings.format;
  RawImage out = part_of(image, settings, rows);
  if (settings.gain > 0 || settings.black_level != body.black_level) {
    const double factor = std::pow(10, settings.gain / 20);
    const double white = (1 << body.bits) - 1;
    for (std::uint16_t& count : out.counts) {
      const double amplified = settings.black_level + factor * (count - body.black_level);
      count = static_cast<std::uint16_t>(std::clamp(amplified, 0.0, white));
    }
  }
  const int shift = format.bits - body.bits;
  if (shift == 0) return out;
  for (std::uint16_t& count : out.counts)
    count = static_cast<std::uint16_t>(shift > 0 ? count << shift : count >> -shift);
  return out;
}

void append_chunk(Packet& data, std::uint64_t value, std::uint32_t id) {
  append32(data, static_cast<std::uint32_t>(value >> 32));
  append32(data, static_cast<std::uint32_t>(value));
  append32(data, id);
  append32(data, 8);
}

}  // namespace

Acquisition::Acquisition(const CameraBody& body, Sensor sensor, Clock& clock, GvspStream& stream,
                         CameraWireFaults& faults, Owner owner)
    : body_(body),
      sensor_(std::move(sensor)),
      clock_(clock),
      stream_(stream),
      faults_(faults),
      owner_(std::move(owner)),
      thread_([this](const std::stop_token& stop) { work(stop); }) {}

Acquisition::~Acquisition() {
  stop();
  thread_.request_stop();
}

void Acquisition::start() {
  const std::lock_guard lock(mutex_);
  if (running_) return;
  run_ = std::stop_source();
  running_ = true;
  triggered_ = false;
  woken_.notify_all();
}

void Acquisition::stop() {
  const std::lock_guard lock(mutex_);
  running_ = false;
  run_.request_stop();
  woken_.notify_all();
}

void Acquisition::trigger() {
  const std::lock_guard lock(mutex_);
  // A start is acted upon within microseconds; a trigger right behind it must not be lost to that.
  if (!running_ || (!armed_ && triggered_)) return;
  triggered_ = true;
  woken_.notify_all();
}

void Acquisition::work(const std::stop_token& stop) {
  while (!stop.stop_requested()) {
    std::stop_token run;
    {
      std::unique_lock lock(mutex_);
      if (!woken_.wait(lock, stop, [&] { return running_; })) return;
      run = run_.get_token();
    }
    const TimePoint begin = clock_.now();
    CaptureSettings settings = owner_.next_shot().settings;
    if (settings.triggered && !wait_for_trigger(run)) continue;
    take(owner_.next_shot(), run);
    if (run.stop_requested()) continue;
    if (settings.single_frame) {
      const std::lock_guard lock(mutex_);
      // A new start may have come meanwhile: it is another run and goes on.
      if (run_.get_token() == run) running_ = false;
    } else if (!settings.triggered && settings.frame_period > 0) {
      clock_.sleep_until(begin + nanoseconds_of(settings.frame_period), run);
    }
  }
}

bool Acquisition::wait_for_trigger(const std::stop_token& run) {
  std::unique_lock lock(mutex_);
  armed_ = true;
  const bool came = woken_.wait(lock, run, [&] { return triggered_; });
  armed_ = false;
  triggered_ = false;
  return came && !run.stop_requested();
}

/// What befalls the camera rather than the frame; false when there is no frame to be had.
bool Acquisition::survives(const std::vector<CameraFault>& struck) {
  bool alive = true;
  for (const CameraFault& fault : struck) {
    if (fault.kind != CameraFaultKind::frozen && fault.kind != CameraFaultKind::rebooted &&
        fault.kind != CameraFaultKind::privilege_stolen)
      continue;
    owner_.accident(fault);
    alive = false;
  }
  return alive;
}

void Acquisition::take(const Shot& shot, const std::stop_token& run) {
  const std::vector<CameraFault> struck = faults_.begin_frame();
  if (!survives(struck)) return;
  double exposure = shot.settings.exposure;
  if (strikes(struck, CameraFaultKind::wrong_exposure))
    exposure *= 2 * exposure <= body_.max_exposure ? 2 : 0.5;
  const TimePoint begin = clock_.now();
  clock_.sleep_until(begin + nanoseconds_of(exposure / 2), run);
  if (run.stop_requested()) return;
  const Result<Frame> frame = sensor_(exposure, run);
  if (!frame) return;
  clock_.sleep_until(begin + nanoseconds_of(exposure + body_.readout_time), run);
  if (run.stop_requested()) return;

  const CaptureSettings& settings = shot.settings;
  const int rows =
      strikes(struck, CameraFaultKind::wrong_size) ? settings.height / 2 : settings.height;
  WireFrame wire;
  wire.facts.timestamp = shot.timestamp;
  wire.facts.pixel_format = settings.format->code;
  wire.facts.width = static_cast<std::uint32_t>(settings.width);
  wire.facts.height = static_cast<std::uint32_t>(rows);
  wire.facts.x = static_cast<std::uint32_t>(settings.x);
  wire.facts.y = static_cast<std::uint32_t>(settings.y);
  wire.facts.chunks = settings.chunk_mode;
  ++taken_;
  wire.data = encode(*frame, shot, exposure, rows);
  if (strikes(struck, CameraFaultKind::stale_frame)) {
    if (last_.data.empty()) return;
    wire = last_;
  }
  last_ = wire;
  stream_.send(std::move(wire), shot.target, struck, faults_, run);
}

std::vector<std::uint8_t> Acquisition::encode(const Frame& frame, const Shot& shot, double exposure,
                                              int rows) const {
  const CaptureSettings& settings = shot.settings;
  const std::vector<std::byte> image =
      pack(*settings.format, in_format(frame.counts, body_, settings, rows));
  Packet data(image.size());
  std::ranges::transform(image, data.begin(),
                         [](std::byte b) { return std::to_integer<std::uint8_t>(b); });
  if (!settings.chunk_mode) return data;
  append32(data, image_chunk_id);
  append32(data, static_cast<std::uint32_t>(image.size()));
  const std::array<std::uint64_t, chunk_count> values = {
      taken_, std::bit_cast<std::uint64_t>(exposure * 1e6), shot.timestamp,
      static_cast<std::uint64_t>(settings.x), static_cast<std::uint64_t>(settings.y)};
  for (std::size_t i = 0; i < chunk_count; ++i)
    if (settings.chunks[i]) append_chunk(data, values[i], chunk_id(static_cast<Chunk>(i)));
  return data;
}

}  // namespace lightrig::sim
