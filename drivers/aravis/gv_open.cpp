// Opening a camera and making its settings ours.
#include <fmt/format.h>

#include <cmath>
#include <fstream>

#include "drivers/aravis/gv_error.h"
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

/// Any GenICam feature of the rig file, by the type of its node.
Result<void> set_any(ArvCamera* camera, const std::string& feature, const std::string& value) {
  ArvDevice* device = arv_camera_get_device(camera);
  ArvGcNode* node = arv_device_get_feature(device, feature.c_str());
  if (!node)
    return fail(ErrorCode::not_found,
                fmt::format("[camera.aravis] features: this camera has no feature {}", feature));
  GError* error = nullptr;
  if (ARV_IS_GC_COMMAND(node)) {
    arv_device_execute_command(device, feature.c_str(), &error);
  } else {
    // GenICam nodes convert from text themselves, whatever their type.
    arv_gc_feature_node_set_value_from_string(ARV_GC_FEATURE_NODE(node), value.c_str(), &error);
  }
  if (error) return gv_fail(fmt::format("set {} = {}", feature, value), error);
  return {};
}

/// The kernel's ceiling on UDP receive buffers; a smaller one silently cuts ours and loses whole
/// frames.
std::optional<long> kernel_receive_limit() {
  std::ifstream in("/proc/sys/net/core/rmem_max");
  long limit = 0;
  if (in >> limit) return limit;
  return std::nullopt;
}

}  // namespace

Result<std::unique_ptr<GvSession>> GvSession::open(const Rig& rig, const AravisCamera& backend) {
  auto session = std::unique_ptr<GvSession>(new GvSession(rig, backend));
  for (const auto& step :
       {&GvSession::connect, &GvSession::configure_format, &GvSession::configure_fixed_settings,
        &GvSession::configure_trigger, &GvSession::open_stream, &GvSession::prove_stream}) {
    if (auto done = (session.get()->*step)(); !done)
      return tl::unexpected(with_context("camera " + backend.id, done.error()));
  }
  return session;
}

Result<void> GvSession::connect() {
  GError* error = nullptr;
  camera_.reset(arv_camera_new(backend_.id.empty() ? nullptr : backend_.id.c_str(), &error));
  if (!camera_) {
    auto failure = gv_fail("open", error);
    failure.value().message +=
        "; check power, cable and subnet, and `lightrig devices`; by IP address discovery is not "
        "needed";
    if (failure.value().code == ErrorCode::refused) failure.value().code = ErrorCode::not_found;
    return failure;
  }
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

Result<void> GvSession::configure_format() {
  const CameraConfig& config = rig_.camera;
  format_ = backend_.pixel_format.empty()
                ? plain_pixel_format(config.sensor.filter, config.sensor.bits)
                : find_pixel_format(backend_.pixel_format);
  if (!format_)
    return fail(ErrorCode::invalid_input,
                fmt::format("pixel format \"{}\" for {} bits is not one that lightrig decodes",
                            backend_.pixel_format, config.sensor.bits));
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
    arv_camera_set_boolean(camera_.get(), "GammaEnable", FALSE, nullptr);
  if (has_entry(camera_.get(), "ExposureMode", "Timed"))
    if (auto set = set_text(camera_.get(), "ExposureMode", "Timed"); !set) return set;
  for (const auto& [feature, value] : backend_.features)
    if (auto set = set_any(camera_.get(), feature, value); !set) return set;
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
    return fail(ErrorCode::invalid_input,
                fmt::format("the rig file offers exposures of {} … {} s, the camera {} … {} s",
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

Result<void> GvSession::open_stream() {
  GError* error = nullptr;
  if (!backend_.packet_socket)
    arv_camera_gv_set_stream_options(camera_.get(), ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
  if (backend_.packet_size > 0)
    arv_camera_gv_set_packet_size(camera_.get(), backend_.packet_size, &error);
  else
    arv_camera_gv_auto_packet_size(camera_.get(), &error);
  if (error) return gv_fail("negotiate the packet size", error);
  const auto limit = kernel_receive_limit();
  if (!backend_.packet_socket && limit && *limit < backend_.socket_buffer_bytes)
    return fail(
        ErrorCode::refused,
        fmt::format("the kernel allows UDP receive buffers of {} bytes, the rig file asks "
                    "for {}: frames would be lost; run `sysctl -w net.core.rmem_max={}`, or "
                    "set packet_socket = true and give lightrigd CAP_NET_RAW",
                    *limit, backend_.socket_buffer_bytes, backend_.socket_buffer_bytes));
  stream_.reset(arv_camera_create_stream(camera_.get(), nullptr, nullptr, &error));
  if (!stream_) return gv_fail("open the stream", error);
  g_object_set(stream_.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED,
               "socket-buffer-size", backend_.socket_buffer_bytes, "packet-resend",
               ARV_GV_STREAM_PACKET_RESEND_ALWAYS, nullptr);
  const guint payload = arv_camera_get_payload(camera_.get(), &error);
  if (error) return gv_fail("read the payload size", error);
  for (int i = 0; i < 4; ++i)
    arv_stream_push_buffer(stream_.get(), arv_buffer_new(payload, nullptr));
  if (software_trigger_) {
    arv_camera_start_acquisition(camera_.get(), &error);
    if (error) return gv_fail("start the acquisition", error);
  }
  return {};
}

// One throw-away frame says now, not in the middle of a night, that frames arrive. It also makes
// Aravis enlarge the socket buffer, which it does only when the first leader comes: that frame
// alone may lose packets.
Result<void> GvSession::prove_stream() {
  Result<Frame> frame = fail(ErrorCode::timed_out, "not tried");
  for (int attempt = 0; attempt < 3 && !frame; ++attempt)
    frame = expose(rig_.camera.sensor.min_exposure, {});
  if (!frame) return tl::unexpected(with_context("three test frames failed", frame.error()));
  counters_ = {};
  return {};
}

}  // namespace lightrig
