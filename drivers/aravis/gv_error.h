#pragma once

#include <arv.h>

#include <string>
#include <string_view>

#include "core/result.h"

namespace lightrig {

/// A GError as ours; frees it. Timeouts and lost control mean the camera is gone: reopen.
inline tl::unexpected<Error> gv_fail(std::string_view doing, GError* error) {
  ErrorCode code = ErrorCode::refused;
  std::string message = error ? error->message : "unknown reason";
  if (error && error->domain == ARV_DEVICE_ERROR) {
    switch (static_cast<ArvDeviceError>(error->code)) {
      case ARV_DEVICE_ERROR_TIMEOUT:
      case ARV_DEVICE_ERROR_NOT_CONNECTED:
      case ARV_DEVICE_ERROR_TRANSFER_ERROR:
        code = ErrorCode::disconnected;
        break;
      case ARV_DEVICE_ERROR_NOT_FOUND:
      case ARV_DEVICE_ERROR_FEATURE_NOT_FOUND:
        code = ErrorCode::not_found;
        break;
      default:
        break;
    }
  }
  g_clear_error(&error);
  return fail(code, std::string(doing) + ": " + message);
}

}  // namespace lightrig
