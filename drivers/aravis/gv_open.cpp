// Opening a camera and making its settings ours.
#include <fmt/format.h>

#include <charconv>
#include <utility>

#include "drivers/aravis/gv_error.h"
#include "drivers/aravis/gv_features.h"
#include "drivers/aravis/gv_find.h"
#include "drivers/aravis/gv_preflight.h"
#include "drivers/aravis/gv_session.h"

namespace lightrig {
Result<std::unique_ptr<GvSession>> GvSession::open(const Rig& rig, const AravisCamera& backend) {
  auto session = std::unique_ptr<GvSession>(new GvSession(rig, backend));
  for (const auto& step :
       {&GvSession::connect, &GvSession::load_user_set, &GvSession::switch_automatics_off,
        &GvSession::configure_features, &GvSession::configure_format,
        &GvSession::configure_fixed_settings, &GvSession::configure_gain,
        &GvSession::configure_trigger, &GvSession::configure_witnesses, &GvSession::open_stream,
        &GvSession::prove_stream}) {
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

// What the rig file does not name is as the factory set it, not as somebody left it: one command
// for hundreds of features, where the model has it. The rest of what bends a picture is written
// below, for a model without.
Result<void> GvSession::load_user_set() {
  const auto named = backend_.features.find("UserSetSelector");
  const bool is_named = named != backend_.features.end();
  const std::string set = is_named ? named->second : "Default";
  const bool can = has_feature(camera_.get(), "UserSetLoad") &&
                   has_entry(camera_.get(), "UserSetSelector", set.c_str());
  if (!can && is_named)
    return fail(ErrorCode::not_found,
                fmt::format("[camera.aravis.features] UserSetSelector = {}: this camera has no "
                            "such user set; `arv-tool-0.8 values UserSetSelector` lists them",
                            set));
  if (!can) return {};
  if (auto chosen = set_text(camera_.get(), "UserSetSelector", set); !chosen) return chosen;
  GError* error = nullptr;
  arv_camera_execute_command(camera_.get(), "UserSetLoad", &error);
  if (error) return gv_fail(fmt::format("load the user set {}", set), error);
  identity_ += fmt::format("; user set {}", set);
  return {};
}

bool GvSession::is_named(const std::string& feature) const {
  return backend_.features.contains(feature);
}

// The rig file's own features come first: what the session needs is set after them and wins.
Result<void> GvSession::configure_features() {
  for (const auto& [feature, value] : backend_.features) {
    const bool loaded = feature == "UserSetSelector" || feature == "UserSetLoad";
    const bool after_size = feature == "OffsetX" || feature == "OffsetY";
    if (loaded || after_size) continue;
    if (auto set = set_any(camera_.get(), feature, value); !set) return set;
  }
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
  return configure_region();
}

// Where the picture lies on the sensor is as much part of the camera's model as its size. An offset
// that somebody left limits the size that can be set: it goes first.
Result<void> GvSession::configure_region() {
  ArvCamera* camera = camera_.get();
  for (const char* factor :
       {"BinningHorizontal", "BinningVertical", "DecimationHorizontal", "DecimationVertical"})
    if (!is_named(factor) && has_feature(camera, factor))
      if (auto set = set_whole(camera, factor, 1); !set) return set;
  for (const char* mirror : {"ReverseX", "ReverseY"})
    if (!is_named(mirror) && has_feature(camera, mirror))
      if (auto set = set_off(camera, mirror,
                             "its picture would be mirrored; switch it off with the maker's tool");
          !set)
        return set;
  const auto set_offsets = [&](const auto& value_of_one) -> Result<void> {
    for (const char* offset : {"OffsetX", "OffsetY"}) {
      const auto value = value_of_one(offset);
      if (!value) return tl::unexpected(value.error());
      if (!is_named(offset) && !has_feature(camera, offset)) continue;
      if (auto set = set_whole(camera, offset, *value); !set)
        return tl::unexpected(with_context("place the picture on the sensor", set.error()));
    }
    return {};
  };
  const auto none = [](const std::string&) -> Result<gint64> { return 0; };
  const auto of_the_rig = [&](const std::string& offset) -> Result<gint64> {
    const auto named = backend_.features.find(offset);
    if (named == backend_.features.end()) return 0;
    const std::string& text = named->second;
    gint64 value = 0;
    const auto [end, bad] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (bad == std::errc() && end == text.data() + text.size()) return value;
    return fail(ErrorCode::invalid_input,
                fmt::format("[camera.aravis.features] {} = {}: a whole number of pixels is wanted",
                            offset, text));
  };
  if (auto set = set_offsets(none); !set) return set;
  const CameraModel& model = rig_.camera.model;
  GError* error = nullptr;
  arv_camera_set_region(camera, -1, -1, model.width, model.height, &error);
  if (error) return gv_fail("set the image size", error);
  const gint64 width = arv_camera_get_integer(camera, "Width", &error);
  const gint64 height = error ? 0 : arv_camera_get_integer(camera, "Height", &error);
  if (error) return gv_fail("read the image size back", error);
  if (width != model.width || height != model.height)
    return fail(ErrorCode::refused,
                fmt::format("asked for {} × {} pixels, but the camera gives {} × {}", model.width,
                            model.height, width, height));
  return set_offsets(of_the_rig);
}

// Whatever adjusts itself would make frames incomparable, and locks what it adjusts: off before the
// rig file's own features are set, and after, whatever they are. A model without the feature has
// nothing to switch off.
Result<void> GvSession::switch_automatics_off() {
  for (const char* automatic : {"ExposureAuto", "GainAuto", "BalanceWhiteAuto", "BlackLevelAuto",
                                "TestPattern", "TestImageSelector"}) {
    if (!has_entry(camera_.get(), automatic, "Off")) continue;
    if (auto set = set_text(camera_.get(), automatic, "Off"); !set) return set;
  }
  return {};
}

Result<void> GvSession::configure_fixed_settings() {
  if (auto off = switch_automatics_off(); !off) return off;
  for (const char* curve : {"GammaEnable", "LUTEnable"})
    if (has_feature(camera_.get(), curve))
      if (auto set = set_off(camera_.get(), curve,
                             "its counts would not be linear in light; set its curve to a "
                             "straight line with the maker's tool and lock it off");
          !set)
        return set;
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

// The sensor's numbers in the rig file hold at one gain: none, unless the rig file names one. A
// black level has no such value of its own: it is as the user set has it, and said.
Result<void> GvSession::configure_gain() {
  if (!is_named("Gain") && !is_named("GainRaw") && !is_named("GainAbs")) {
    const std::string selected = value_of(camera_.get(), "GainSelector");
    for (const std::string& one : entries_of(camera_.get(), "GainSelector")) {
      if (auto chosen = set_text(camera_.get(), "GainSelector", one); !chosen) return chosen;
      if (auto set = set_least_gain(camera_.get()); !set)
        return tl::unexpected(with_context(one, set.error()));
    }
    if (!selected.empty())
      if (auto back = set_text(camera_.get(), "GainSelector", selected); !back) return back;
    if (auto set = set_least_gain(camera_.get()); !set) return set;
  }
  for (const char* level : {"Gain", "GainRaw", "BlackLevel", "BlackLevelRaw"})
    if (const std::string value = value_of(camera_.get(), level); !value.empty())
      identity_ += fmt::format("; {} {}", level, value);
  return {};
}

// A trigger of any kind that somebody left on would be waited for, for ever.
Result<void> GvSession::clear_triggers() {
  const std::string selected = value_of(camera_.get(), "TriggerSelector");
  for (const std::string& one : entries_of(camera_.get(), "TriggerSelector")) {
    if (auto chosen = set_text(camera_.get(), "TriggerSelector", one); !chosen) return chosen;
    if (!has_entry(camera_.get(), "TriggerMode", "Off")) continue;
    if (auto off = set_text(camera_.get(), "TriggerMode", "Off"); !off)
      return tl::unexpected(with_context(one, off.error()));
  }
  if (!selected.empty())
    if (auto back = set_text(camera_.get(), "TriggerSelector", selected); !back) return back;
  if (!has_entry(camera_.get(), "TriggerMode", "Off")) return {};
  return set_text(camera_.get(), "TriggerMode", "Off");
}

Result<void> GvSession::configure_trigger() {
  if (auto cleared = clear_triggers(); !cleared) return cleared;
  if (backend_.trigger != "software") {
    if (has_entry(camera_.get(), "AcquisitionMode", "SingleFrame") &&
        set_text(camera_.get(), "AcquisitionMode", "SingleFrame"))
      return {};
    // The model has no single frame: run freely, take the first frame begun after the start, stop.
    return set_text(camera_.get(), "AcquisitionMode", "Continuous");
  }
  GError* error = nullptr;
  if (!arv_camera_is_software_trigger_supported(camera_.get(), &error) || error) {
    g_clear_error(&error);
    return fail(ErrorCode::refused,
                "it has no software trigger: set trigger = \"single_frame\" in [camera.aravis]");
  }
  if (auto set = set_text(camera_.get(), "AcquisitionMode", "Continuous"); !set) return set;
  arv_camera_set_trigger(camera_.get(), "Software", &error);
  if (error) return gv_fail("select the software trigger", error);
  for (const auto& [feature, wanted] :
       {std::pair{"TriggerMode", "On"}, std::pair{"TriggerSource", "Software"}})
    if (const std::string said = value_of(camera_.get(), feature); said != wanted)
      return fail(ErrorCode::refused,
                  fmt::format("set {} = {}, but the camera says {}", feature, wanted, said));
  software_trigger_ = true;
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
    const bool active = !error && arv_camera_get_chunk_mode(camera_.get(), &error) != FALSE;
    const bool written =
        active && arv_camera_get_chunk_state(camera_.get(), "ExposureTime", &error) != FALSE;
    if (!error && written) chunks_.reset(arv_camera_create_chunk_parser(camera_.get()));
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
