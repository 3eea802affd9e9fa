#include "drivers/aravis/gv_session.h"

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <limits>

#include "drivers/aravis/gv_error.h"

namespace lightrig {
namespace {

/// Time a frame may need beyond exposure and readout: leader, packets, rounds of resends, a busy
/// host. The session waits two seconds longer, so that the reason given is this driver's.
constexpr std::chrono::milliseconds transfer_margin{3000};
/// An exposure read back may differ by the camera's own steps.
constexpr double exposure_tolerance = 0.01;
constexpr double exposure_step_s = 2e-6;

const char* status_text(ArvBufferStatus status) {
  switch (status) {
    case ARV_BUFFER_STATUS_SUCCESS:
      return "complete";
    case ARV_BUFFER_STATUS_TIMEOUT:
      return "packets did not arrive in time";
    case ARV_BUFFER_STATUS_MISSING_PACKETS:
      return "packets are missing";
    case ARV_BUFFER_STATUS_WRONG_PACKET_ID:
      return "a packet has a wrong id";
    case ARV_BUFFER_STATUS_SIZE_MISMATCH:
      return "the image is larger than its buffer";
    case ARV_BUFFER_STATUS_ABORTED:
      return "the transfer was aborted";
    default:
      return "unknown state";
  }
}

}  // namespace

GvSession::~GvSession() {
  if (camera_ && !lost_) arv_camera_stop_acquisition(camera_.get(), nullptr);
}

CameraCounters GvSession::counters() const {
  CameraCounters counters = counters_;
  guint64 resent = 0;
  guint64 missing = 0;
  if (stream_ && ARV_IS_GV_STREAM(stream_.get()))
    arv_gv_stream_get_statistics(ARV_GV_STREAM(stream_.get()), &resent, &missing);
  counters.packets_resent = resent + static_cast<guint64>(resent_before_);
  counters.packets_lost = missing + static_cast<guint64>(lost_before_);
  return counters;
}

/// A refusal of access means that the privilege, which we had, is gone.
tl::unexpected<Error> GvSession::lost_or_failed(const std::string& doing, GError* error) {
  const bool denied =
      g_error_matches(error, ARV_DEVICE_ERROR, ARV_DEVICE_ERROR_PROTOCOL_ERROR_ACCESS_DENIED) ||
      g_error_matches(error, ARV_DEVICE_ERROR, ARV_DEVICE_ERROR_NOT_CONTROLLER);
  auto failure = gv_fail(doing, error);
  if (denied) {
    failure.value().code = ErrorCode::disconnected;
    failure.value().message +=
        ": the camera no longer obeys us: it restarted, or another program took control of it";
  }
  if (failure.value().code == ErrorCode::disconnected) lost_ = true;
  return failure;
}

Result<double> GvSession::apply_exposure(double seconds) {
  const SensorModel& sensor = rig_.camera.sensor;
  if (!(seconds >= sensor.min_exposure * (1 - 1e-9) && seconds <= sensor.max_exposure * (1 + 1e-9)))
    return fail(ErrorCode::refused,
                fmt::format("an exposure of {} s is outside the camera's {} … {} s", seconds,
                            sensor.min_exposure, sensor.max_exposure));
  GError* error = nullptr;
  arv_camera_set_exposure_time(camera_.get(), seconds * 1e6, &error);
  if (error) return lost_or_failed(fmt::format("set the exposure to {} s", seconds), error);
  const double applied = arv_camera_get_exposure_time(camera_.get(), &error) / 1e6;
  if (error) return lost_or_failed("read the exposure back", error);
  if (std::abs(applied - seconds) > exposure_tolerance * seconds + exposure_step_s)
    return fail(ErrorCode::refused,
                fmt::format("asked for an exposure of {} s, but the camera took {} s: offer "
                            "exposures that the camera can make",
                            seconds, applied));
  return applied;
}

// The camera's own clock, now [ns]; a frame with an earlier time was not asked for.
Result<std::uint64_t> GvSession::camera_time() {
  GError* error = nullptr;
  ArvDevice* device = arv_camera_get_device(camera_.get());
  arv_device_execute_command(device, latch_command_.c_str(), &error);
  gint64 time = 0;
  if (!error) time = arv_device_get_integer_feature_value(device, latch_value_.c_str(), &error);
  if (error) return lost_or_failed("read the camera's clock", error);
  return static_cast<std::uint64_t>(time);
}

void GvSession::return_buffer(GRef<ArvBuffer> buffer) {
  arv_stream_push_buffer(stream_.get(), buffer.release());
}

void GvSession::drop_stale_buffers() {
  while (ArvBuffer* buffer = arv_stream_try_pop_buffer(stream_.get())) {
    if (arv_buffer_get_status(buffer) == ARV_BUFFER_STATUS_SUCCESS) (void)fresh_id(buffer);
    return_buffer(GRef<ArvBuffer>(buffer));
  }
}

Result<void> GvSession::trigger() {
  GError* error = nullptr;
  if (software_trigger_)
    arv_camera_software_trigger(camera_.get(), &error);
  else
    arv_camera_start_acquisition(camera_.get(), &error);
  if (error) return lost_or_failed("trigger the exposure", error);
  return {};
}

bool GvSession::is_stale(ArvBuffer* buffer) const {
  if (latch_command_.empty() || check_latch_) return false;
  if (arv_buffer_get_frame_id(buffer) == 0) return false;  // no leader came: it has no time
  const std::uint64_t timestamp = arv_buffer_get_timestamp(buffer);
  return timestamp != 0 && timestamp < triggered_at_;
}

// The first buffer that belongs to this exposure. What the camera still had to deliver of an
// earlier one is thrown away.
Result<GRef<ArvBuffer>> GvSession::wait_for_buffer(double seconds, const std::stop_token& stop) {
  using std::chrono::steady_clock;
  const std::chrono::duration<double> patience =
      std::chrono::duration<double>(seconds + rig_.camera.readout_time) + transfer_margin;
  const auto deadline =
      steady_clock::now() + std::chrono::duration_cast<steady_clock::duration>(patience);
  int stale = 0;
  nothing_came_ = false;
  while (steady_clock::now() < deadline) {
    if (stop.stop_requested()) return fail(ErrorCode::stopped, "stopped on request");
    if (GRef<ArvBuffer> buffer{arv_stream_timeout_pop_buffer(stream_.get(), 5000)}) {
      if (!is_stale(buffer.get())) return buffer;
      return_buffer(std::move(buffer));
      ++stale;
    }
    if (!arv_gv_device_is_controller(ARV_GV_DEVICE(arv_camera_get_device(camera_.get()))))
      lost_ = true;
    if (lost_)
      return fail(ErrorCode::disconnected,
                  "the camera's control privilege is lost: unplugged, restarted, or taken over");
  }
  nothing_came_ = stale == 0;
  return fail(ErrorCode::timed_out,
              fmt::format("no frame within {:.1f} s of an exposure of {} s{}: check that nothing "
                          "blocks UDP from the camera, its packet size and the trigger mode",
                          patience.count(), seconds,
                          stale > 0 ? fmt::format(" ({} stale ones came)", stale) : ""));
}

// Many cameras have no clock; then the frame count tells a frame that came already.
Result<std::uint64_t> GvSession::fresh_id(ArvBuffer* buffer) {
  const std::uint64_t block = arv_buffer_get_frame_id(buffer);
  const std::uint64_t timestamp = arv_buffer_get_timestamp(buffer);
  const bool stale = timestamp != 0 ? timestamp <= last_timestamp_ : block == last_block_;
  if (stale)
    return fail(ErrorCode::timed_out,
                fmt::format("a stale frame came: number {}, camera time {} ns", block, timestamp));
  if (block <= last_block_) id_offset_ += last_block_;
  last_block_ = block;
  last_timestamp_ = timestamp;
  return block + id_offset_;
}

// What the camera wrote behind the picture of how long it exposed.
Result<void> GvSession::check_chunk(ArvBuffer* buffer, double exposure) {
  if (!chunks_) return {};
  GError* error = nullptr;
  const double said =
      arv_chunk_parser_get_float_value(chunks_.get(), buffer, "ChunkExposureTime", &error) / 1e6;
  if (error)
    return gv_fail(
        "read the frame's own exposure (ChunkExposureTime); where this model cannot "
        "give it, set ChunkModeActive = false in [camera.aravis.features]",
        error);
  if (std::abs(said - exposure) > exposure_tolerance * exposure + exposure_step_s)
    return fail(
        ErrorCode::timed_out,
        fmt::format("a frame came that was exposed for {} s instead of {} s", said, exposure));
  return {};
}

Result<Frame> GvSession::accept(ArvBuffer* buffer, double exposure) {
  // A failed buffer's geometry getters may assert: look at the status first.
  const ArvBufferStatus status = arv_buffer_get_status(buffer);
  if (status != ARV_BUFFER_STATUS_SUCCESS)
    return fail(
        ErrorCode::timed_out,
        fmt::format("the frame is not whole: {}; {} packets resent, {} lost so far; see "
                    "docs/hardware.md on packet size, socket buffer and MTU",
                    status_text(status), counters().packets_resent, counters().packets_lost));
  const auto id = fresh_id(buffer);
  if (!id) return tl::unexpected(id.error());
  const int width = arv_buffer_get_image_width(buffer);
  const int height = arv_buffer_get_image_height(buffer);
  // Size and format were read back at opening: one frame that has others is a doubtful frame.
  if (width != rig_.camera.model.width || height != rig_.camera.model.height)
    return fail(ErrorCode::timed_out,
                fmt::format("a frame of {} × {} pixels came, the rig file says {} × {}", width,
                            height, rig_.camera.model.width, rig_.camera.model.height));
  if (arv_buffer_get_image_pixel_format(buffer) != format_->code)
    return fail(ErrorCode::timed_out,
                fmt::format("a frame of pixel format {:#010x} came instead of {}",
                            arv_buffer_get_image_pixel_format(buffer), format_->name));
  std::size_t size = 0;
  const void* data = arv_buffer_get_image_data(buffer, &size);
  // With chunks the data end in a trailer: the image is the first payload_bytes of it.
  const std::size_t expected = payload_bytes(*format_, width, height);
  if (auto checked = check_chunk(buffer, exposure); !checked)
    return tl::unexpected(checked.error());
  auto image =
      unpack(*format_, {static_cast<const std::byte*>(data), size < expected ? size : expected},
             width, height);
  if (!image) return tl::unexpected(with_context("unpack the frame", image.error()));
  return Frame{std::move(*image), exposure, *id};
}

Result<Frame> GvSession::expose(double seconds, const std::stop_token& stop) {
  if (lost_) return fail(ErrorCode::disconnected, "the camera is lost: reopen it");
  auto applied = apply_exposure(seconds);
  if (!applied) return tl::unexpected(applied.error());
  if (stream_for_each_start_)
    if (auto anew = create_stream(); !anew) return tl::unexpected(anew.error());
  drop_stale_buffers();
  Result<Frame> frame = take(*applied, stop);
  if (frame && has_temperature_) {
    GError* error = nullptr;
    const double celsius = arv_camera_get_float(camera_.get(), "DeviceTemperature", &error);
    // What cannot be read is not known; the frame is whole all the same.
    counters_.temperature_c = error ? std::optional<double>() : std::optional(celsius);
    g_clear_error(&error);
  }
  if (frame)
    ++counters_.frames;
  else if (frame.error().code != ErrorCode::stopped)
    ++counters_.rejected;
  return frame;
}

Result<Frame> GvSession::take(double applied, const std::stop_token& stop) {
  if (!latch_command_.empty()) {
    const auto now = camera_time();
    if (!now) return tl::unexpected(now.error());
    triggered_at_ = *now;
  }
  if (auto triggered = trigger(); !triggered) return tl::unexpected(triggered.error());
  auto buffer = wait_for_buffer(applied, stop);
  if (!lost_ && (!software_trigger_ || !buffer))
    arv_camera_stop_acquisition(camera_.get(), nullptr);
  if (!lost_ && software_trigger_ && !buffer)
    arv_camera_start_acquisition(camera_.get(), nullptr);  // ready for the next trigger
  if (!buffer) return tl::unexpected(buffer.error());
  Result<Frame> frame = accept(buffer->get(), applied);
  if (frame && check_latch_) {
    // Frames are held against the clock only if both tell the same time.
    const auto after = camera_time();
    const std::uint64_t taken = arv_buffer_get_timestamp(buffer->get());
    if (!after || taken < triggered_at_ || taken > *after) latch_command_.clear();
  }
  return_buffer(std::move(*buffer));
  return frame;
}

}  // namespace lightrig
