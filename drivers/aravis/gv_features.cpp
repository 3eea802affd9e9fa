#include "drivers/aravis/gv_features.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

#include "drivers/aravis/gv_error.h"

namespace lightrig {

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

std::vector<std::string> entries_of(ArvCamera* camera, const char* feature) {
  std::vector<std::string> all;
  if (!has_feature(camera, feature)) return all;
  guint count = 0;
  GError* error = nullptr;
  const char** names =
      arv_camera_dup_available_enumerations_as_strings(camera, feature, &count, &error);
  g_clear_error(&error);
  for (guint i = 0; names && i < count; ++i) all.emplace_back(names[i]);
  g_free(names);
  return all;
}

std::string value_of(ArvCamera* camera, const char* feature) {
  ArvGcNode* node = arv_device_get_feature(arv_camera_get_device(camera), feature);
  if (!node || !has_feature(camera, feature)) return "";
  GError* error = nullptr;
  const char* text = arv_gc_feature_node_get_value_as_string(ARV_GC_FEATURE_NODE(node), &error);
  const std::string value = error || !text ? "" : text;
  g_clear_error(&error);
  return value;
}

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

Result<void> set_whole(ArvCamera* camera, const std::string& feature, gint64 value) {
  GError* error = nullptr;
  const gint64 before = arv_camera_get_integer(camera, feature.c_str(), &error);
  if (!error && before == value) return {};
  g_clear_error(&error);
  arv_camera_set_integer(camera, feature.c_str(), value, &error);
  if (error) return gv_fail(fmt::format("set {} = {}", feature, value), error);
  const gint64 now = arv_camera_get_integer(camera, feature.c_str(), &error);
  if (error) return gv_fail(fmt::format("read {} back", feature), error);
  if (now != value)
    return fail(ErrorCode::refused,
                fmt::format("set {} = {}, but the camera says {}", feature, value, now));
  return {};
}

Result<void> set_off(ArvCamera* camera, const std::string& feature, const std::string& else_what) {
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
                fmt::format("{} was switched off, but the camera says that it is on: {}", feature,
                            else_what));
  return {};
}

Result<void> set_least_gain(ArvCamera* camera) {
  GError* error = nullptr;
  if (!arv_camera_is_gain_available(camera, &error) || error) {
    g_clear_error(&error);
    return {};
  }
  double least = 0;
  double most = 0;
  arv_camera_get_gain_bounds(camera, &least, &most, &error);
  if (error) return gv_fail("read the gain's limits", error);
  const double wanted = std::clamp(0.0, least, std::max(least, most));
  const auto is_set = [&] {
    const double now = arv_camera_get_gain(camera, &error);
    return !error && std::abs(now - wanted) <= 0.01 * std::max(1.0, std::abs(wanted));
  };
  if (is_set()) return {};
  g_clear_error(&error);
  arv_camera_set_gain(camera, wanted, &error);
  if (error) return gv_fail(fmt::format("set the gain to {}", wanted), error);
  if (is_set()) return {};
  if (error) return gv_fail("read the gain back", error);
  return fail(ErrorCode::refused,
              fmt::format("set the gain to {}, but the camera keeps another: name the gain that "
                          "the sensor's numbers were measured at in [camera.aravis.features]",
                          wanted));
}

namespace {

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

}  // namespace

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

}  // namespace lightrig
