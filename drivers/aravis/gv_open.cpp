// Opening a camera and making its settings ours.
#include <fmt/format.h>

#include <cmath>
#include <optional>
#include <utility>

#include "drivers/aravis/gv_error.h"
#include "drivers/aravis/gv_find.h"
#include "drivers/aravis/gv_preflight.h"
#include "drivers/aravis/gv_session.h"

namespace lightrig {
namespace {

/// A feature exists and can be used now; a model that lacks it is no failure.
bool has_feature(ArvCamera* camera, const char* name) {
  GError* error = nullptr;
  const bool has = arv_camera_is_feature_available(camera, name, &error);
  g_clear_error(&error);
  return has;
}

bool has_entry(ArvCamera* camera, const char* feature, const char* entry) {
  GError* error = nullptr;
  const bool has = has_feature(camera, feature) &&
                   arv_camera_is_enumeration_entry_available(camera, feature, entry, &error);
  g_clear_error(&error);
  return has;
}

/// Copies a getter's string at once: it goes stale with the next call.
std::string text_of(const char* text) { return text ? text : "?"; }

/// Sets an enumeration or string feature and reads it back.
Result<void> set_text(ArvCamera* camera, const std::string& feature, const std::string& value) {
  GError* error = nullptr;
  arv_camera_set_string(camera, feature.c_str(), value.c_str(), &error);
  if (error) return gv_fail(fmt::format("set {} = {}", feature, value), error);
  const std::string now = text_of(arv_camera_get_string(camera, feature.c_str(), &error));
  if (error) return gv_fail(fmt::format("read {} back", feature), error);
  if (now != value)
    return fail(ErrorCode::refused,
                fmt::format("set {} = {}, but the camera says {}", feature, value, now));
  return {};
}

/// Switches a boolean feature off and reads it back; one that is off already is not written, since
/// a model may have locked it so.
Result<void> set_off(ArvCamera* camera, const std::string& feature) {
  const auto is_on = [&](GError** error) {
    return arv_camera_get_boolean(camera, feature.c_str(), error) != FALSE;
  };
  GError* error = nullptr;
  const bool was_on = is_on(&error);
  if (!error && !was_on) return {};
  g_clear_error(&error);
  arv_camera_set_boolean(camera, feature.c_str(), FALSE, &error);
  if (error) return gv_fail(fmt::format("switch {} off", feature), error);
  const bool still_on = is_on(&error);
  if (error) return gv_fail(fmt::format("read {} back", feature), error);
  if (still_on)
    return fail(ErrorCode::refused,
                fmt::format("{} was switched off, but the camera says that it is on: its counts "
                            "would not be linear in light; set its gamma to 1 and lock it off",
                            feature));
  return {};
}

/// Whether the camera's words are what was asked for: the same text, or the same number to within
/// the camera's own steps.
bool same_value(const std::string& asked, const std::string& said) {
  if (asked == said) return true;
  const auto number = [](const std::string& text) -> std::optional<double> {
    if (text == "true" || text == "True") return 1;
    if (text == "false" || text == "False") return 0;
    char* end = nullptr;
    const double value = g_ascii_strtod(text.c_str(), &end);
    if (text.empty() || *end != '\0') return std::nullopt;
    return value;
  };
  const auto wanted = number(asked);
  const auto got = number(said);
  return wanted && got && std::abs(*wanted - *got) <= 0.01 * std::abs(*wanted) + 1e-9;
}

/// Any GenICam feature of the rig file, by the type of its node; written, then read back.
Result<void> set_any(ArvCamera* camera, const std::string& feature, const std::string& value) {
  ArvDevice* device = arv_camera_get_device(camera);
  ArvGcNode* node = arv_device_get_feature(device, feature.c_str());
  if (!node)
    return fail(ErrorCode::not_found,
                fmt::format("[camera.aravis.features] {}: this camera has no such feature; "
                            "`arv-tool-0.8 features` lists those it has",
                            feature));
  GError* error = nullptr;
  if (ARV_IS_GC_COMMAND(node)) {
    arv_device_execute_command(device, feature.c_str(), &error);
    if (error) return gv_fail(fmt::format("execute {}", feature), error);
    return {};
  }
  // GenICam nodes convert from text themselves, whatever their type.
  arv_gc_feature_node_set_value_from_string(ARV_GC_FEATURE_NODE(node), value.c_str(), &error);
  if (error) return gv_fail(fmt::format("set {} = {}", feature, value), error);
  const std::string now =
      text_of(arv_gc_feature_node_get_value_as_string(ARV_GC_FEATURE_NODE(node), &error));
  if (error) return gv_fail(fmt::format("read {} back", feature), error);
  if (!same_value(value, now))
    return fail(
        ErrorCode::refused,
        fmt::format("[camera.aravis.features] {} = {}: the camera says {}", feature, value, now));
  return {};
}

}  // namespace

Result<std::unique_ptr<GvSession>> GvSession::open(const Rig& rig, const AravisCamera& backend) {
  auto session = std::unique_ptr<GvSession>(new GvSession(rig, backend));
  for (const auto& step :
       {&GvSession::connect, &GvSession::configure_features, &GvSession::configure_format,
        &GvSession::configure_fixed_settings, &GvSession::configure_trigger,
        &GvSession::configure_witnesses, &GvSession::open_stream, &GvSession::prove_stream}) {
    if (auto done = (session.get()->*step)(); !done)
      return tl::unexpected(with_context("camera " + backend.id, done.error()));
  }
  return session;
}

Result<void> GvSession::connect() {
  if (auto allowed = check_receiving(backend_); !allowed) return allowed;
  auto found = find_camera(backend_);
  if (!found) return tl::unexpected(found.error());
  camera_ = std::move(*found);
  ArvDevice* device = arv_camera_get_device(camera_.get());
  if (!ARV_IS_GV_DEVICE(device))
    return fail(ErrorCode::invalid_input, "it is not a GigE Vision camera");
  // arv_camera_new succeeds without control: another program may hold the camera.
  if (!arv_gv_device_is_controller(ARV_GV_DEVICE(device)))
    return fail(ErrorCode::refused,
                "another program controls it: close that program, or wait out its heartbeat");
  arv_camera_set_range_check_policy(camera_.get(), ARV_RANGE_CHECK_POLICY_ENABLE);
  arv_camera_set_access_check_policy(camera_.get(), ARV_ACCESS_CHECK_POLICY_ENABLE);
  arv_camera_set_register_cache_policy(camera_.get(), ARV_REGISTER_CACHE_POLICY_DISABLE);
  // After a killed client the camera may still be streaming to the old port.
  arv_camera_stop_acquisition(camera_.get(), nullptr);
  const std::string vendor = text_of(arv_camera_get_vendor_name(camera_.get(), nullptr));
  const std::string model = text_of(arv_camera_get_model_name(camera_.get(), nullptr));
  const std::string serial = text_of(arv_camera_get_device_serial_number(camera_.get(), nullptr));
  identity_ = fmt::format("{} {} serial {}", vendor, model, serial);
  return {};
}

// The rig file's own features come first: what the session needs is set after them and wins.
Result<void> GvSession::configure_features() {
  for (const auto& [feature, value] : backend_.features)
    if (auto set = set_any(camera_.get(), feature, value); !set) return set;
  return {};
}

Result<void> GvSession::configure_format() {
  const CameraConfig& config = rig_.camera;
  format_ = backend_.pixel_format.empty()
                ? plain_pixel_format(config.sensor.filter, config.sensor.bits)
                : find_pixel_format(backend_.pixel_format);
  if (!format_)
    return fail(ErrorCode::invalid_input,
                fmt::format("pixel format \"{}\" for {} bits is not one that lightrig decodes",
                            backend_.pixel_format, config.sensor.bits));
  if (format_->bits != config.sensor.bits || format_->filter != config.sensor.filter)
    return fail(ErrorCode::invalid_input,
                fmt::format("pixel format {} has {} bits{}, but [camera.sensor] describes a sensor "
                            "of {} bits with another scale or filter: make them agree",
                            format_->name, format_->bits,
                            format_->filter == config.sensor.filter ? "" : " and its own filter",
                            config.sensor.bits));
  GError* error = nullptr;
  arv_camera_set_pixel_format_from_string(camera_.get(), format_->name.c_str(), &error);
  if (error) return gv_fail(fmt::format("set the pixel format {}", format_->name), error);
  const std::string now = text_of(arv_camera_get_pixel_format_as_string(camera_.get(), &error));
  if (error) return gv_fail("read the pixel format back", error);
  if (now != format_->name)
    return fail(ErrorCode::refused,
                fmt::format("asked for {}, but the camera says {}", format_->name, now));
  gint x = 0;
  gint y = 0;
  gint width = 0;
  gint height = 0;
  arv_camera_set_region(camera_.get(), -1, -1, config.model.width, config.model.height, &error);
  if (error) return gv_fail("set the image size", error);
  arv_camera_get_region(camera_.get(), &x, &y, &width, &height, &error);
  if (error) return gv_fail("read the image size back", error);
  if (width != config.model.width || height != config.model.height)
    return fail(ErrorCode::refused,
                fmt::format("asked for {} × {} pixels, but the camera gives {} × {}",
                            config.model.width, config.model.height, width, height));
  return {};
}

Result<void> GvSession::configure_fixed_settings() {
  // Whatever adjusts itself would make frames incomparable. A model without the feature has nothing
  // to switch off.
  for (const char* automatic : {"ExposureAuto", "GainAuto", "BalanceWhiteAuto", "BlackLevelAuto"}) {
    if (!has_entry(camera_.get(), automatic, "Off")) continue;
    if (auto set = set_text(camera_.get(), automatic, "Off"); !set) return set;
  }
  if (has_feature(camera_.get(), "GammaEnable"))
    if (auto set = set_off(camera_.get(), "GammaEnable"); !set) return set;
  if (has_entry(camera_.get(), "ExposureMode", "Timed"))
    if (auto set = set_text(camera_.get(), "ExposureMode", "Timed"); !set) return set;
  GError* error = nullptr;
  if (!arv_camera_is_exposure_time_available(camera_.get(), &error) || error) {
    g_clear_error(&error);
    return fail(ErrorCode::refused, "its exposure time cannot be set: it is of no use here");
  }
  double least = 0;
  double most = 0;
  arv_camera_get_exposure_time_bounds(camera_.get(), &least, &most, &error);
  if (error) return gv_fail("read the exposure limits", error);
  const SensorModel& sensor = rig_.camera.sensor;
  if (sensor.min_exposure < least * 1e-6 * 0.999 || sensor.max_exposure > most * 1e-6 * 1.001)
    return fail(
        ErrorCode::invalid_input,
        fmt::format(
            "the rig file offers exposures of {:.6g} … {:.6g} s, the camera {:.6g} … {:.6g} s",
            sensor.min_exposure, sensor.max_exposure, least * 1e-6, most * 1e-6));
  return {};
}

Result<void> GvSession::configure_trigger() {
  GError* error = nullptr;
  if (backend_.trigger == "software") {
    if (!arv_camera_is_software_trigger_supported(camera_.get(), &error) || error) {
      g_clear_error(&error);
      return fail(ErrorCode::refused,
                  "it has no software trigger: set trigger = \"single_frame\" in [camera.aravis]");
    }
    arv_camera_set_acquisition_mode(camera_.get(), ARV_ACQUISITION_MODE_CONTINUOUS, &error);
    if (!error) arv_camera_set_trigger(camera_.get(), "Software", &error);
    if (error) return gv_fail("select the software trigger", error);
    software_trigger_ = true;
    return {};
  }
  if (has_entry(camera_.get(), "TriggerMode", "Off"))
    if (auto set = set_text(camera_.get(), "TriggerMode", "Off"); !set) return set;
  if (has_entry(camera_.get(), "AcquisitionMode", "SingleFrame")) {
    arv_camera_set_acquisition_mode(camera_.get(), ARV_ACQUISITION_MODE_SINGLE_FRAME, &error);
    if (!error) return {};
    g_clear_error(&error);
  }
  // The model has no single frame: run freely, take the first frame begun after the start, stop.
  free_running_single_ = true;
  arv_camera_set_acquisition_mode(camera_.get(), ARV_ACQUISITION_MODE_CONTINUOUS, &error);
  if (error) return gv_fail("select continuous acquisition", error);
  return {};
}

// What a frame can be held against besides its settings read back: the exposure that the camera
// itself writes behind the picture, and the camera's clock at the trigger. A model without them has
// its settings and its frame numbers.
Result<void> GvSession::configure_witnesses() {
  GError* error = nullptr;
  const bool left_alone = backend_.features.contains("ChunkModeActive");
  if (!left_alone && arv_camera_are_chunks_available(camera_.get(), nullptr) &&
      has_entry(camera_.get(), "ChunkSelector", "ExposureTime")) {
    arv_camera_set_chunks(camera_.get(), "ExposureTime", &error);
    if (!error) chunks_.reset(arv_camera_create_chunk_parser(camera_.get()));
    g_clear_error(&error);
  }
  for (const auto& [command, value] : {std::pair{"TimestampLatch", "TimestampLatchValue"},
                                       std::pair{"GevTimestampControlLatch", "GevTimestampValue"}})
    if (latch_command_.empty() && has_feature(camera_.get(), command) &&
        has_feature(camera_.get(), value)) {
      latch_command_ = command;
      latch_value_ = value;
    }
  has_temperature_ =
      rig_.pause.camera_temperature && has_feature(camera_.get(), "DeviceTemperature");
  return {};
}

Result<void> GvSession::open_stream() {
  if (!backend_.packet_socket)
    arv_camera_gv_set_stream_options(camera_.get(), ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
  if (auto chosen = choose_packet_size(camera_.get(), backend_); !chosen) return chosen;
  if (auto created = create_stream(); !created) return created;
  if (software_trigger_) {
    GError* error = nullptr;
    arv_camera_start_acquisition(camera_.get(), &error);
    if (error) return gv_fail("start the acquisition", error);
  }
  return {};
}

Result<void> GvSession::create_stream() {
  GError* error = nullptr;
  const CameraCounters so_far = counters();
  stream_.reset();
  resent_before_ = static_cast<std::int64_t>(so_far.packets_resent);
  lost_before_ = static_cast<std::int64_t>(so_far.packets_lost);
  stream_.reset(arv_camera_create_stream(camera_.get(), nullptr, nullptr, &error));
  if (!stream_) return gv_fail("open the stream", error);
  // Every packet that is missing is asked for again, however many there are, and for half a second:
  // Aravis' own tenth gives frames up when the host is busy.
  g_object_set(stream_.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED,
               "socket-buffer-size", backend_.socket_buffer_bytes, "packet-resend",
               ARV_GV_STREAM_PACKET_RESEND_ALWAYS, "packet-request-ratio", 2.0, "frame-retention",
               500000, nullptr);
  const guint payload = arv_camera_get_payload(camera_.get(), &error);
  if (error) return gv_fail("read the payload size", error);
  for (int i = 0; i < 4; ++i)
    arv_stream_push_buffer(stream_.get(), arv_buffer_new(payload, nullptr));
  return {};
}

// Throw-away frames say now, not in the middle of a night, that frames arrive. The first also makes
// Aravis enlarge the socket buffer, which it does only when the first leader comes: that frame
// alone may lose packets. Two are taken, because a camera may count its frames anew from every
// start: Aravis takes the second for a late copy of the first, unless the stream is new as well.
Result<void> GvSession::prove_stream() {
  check_latch_ = !latch_command_.empty();
  for (int proved = 0; proved < 2; ++proved) {
    Result<Frame> frame = fail(ErrorCode::timed_out, "not tried");
    for (int attempt = 0; attempt < 3 && !frame; ++attempt) {
      frame = expose(rig_.camera.sensor.min_exposure, {});
      if (!frame && frame.error().code == ErrorCode::disconnected) break;
      if (!frame && proved == 1 && nothing_came_) stream_for_each_start_ = !software_trigger_;
    }
    if (!frame) return tl::unexpected(with_context("three test frames failed", frame.error()));
  }
  check_latch_ = false;
  const CameraCounters proof = counters();
  resent_before_ -= static_cast<std::int64_t>(proof.packets_resent);
  lost_before_ -= static_cast<std::int64_t>(proof.packets_lost);
  counters_ = {};
  return {};
}

}  // namespace lightrig
