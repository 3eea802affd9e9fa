#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <tl/expected.hpp>
#include <utility>

namespace lightrig {

/// What the world may do to us; each code names the next step of whoever receives it.
enum class ErrorCode : std::uint8_t {
  invalid_input,  ///< The caller's data are wrong: a person must change them.
  not_built,      ///< This build leaves the backend out: install or build another.
  not_found,      ///< The named file, device or address does not exist.
  disconnected,   ///< The device was there and is gone: reopen it.
  timed_out,      ///< No answer before the deadline: may be tried again where that is safe.
  refused,        ///< The device or system answered no: a person must act.
  stopped,        ///< Our own stop request ended the call.
  no_space,       ///< The disk is full: free some and resume.
};

/// Lower-case name of a code, as it is written in logs, journals and JSON.
std::string_view name_of(ErrorCode code);

struct Error {
  ErrorCode code = ErrorCode::invalid_input;
  /// What was attempted, what happened, what to do; no trailing full stop or newline.
  std::string message;
};

template <class T>
using Result = tl::expected<T, Error>;

/// An Error ready to be returned from a function that returns Result<T>.
inline tl::unexpected<Error> fail(ErrorCode code, std::string message) {
  return tl::unexpected<Error>(Error{code, std::move(message)});
}

/// The same error seen from one level up: "doing: message". Each level adds itself once.
inline Error with_context(std::string_view doing, Error error) {
  error.message = std::string(doing) + ": " + error.message;
  return error;
}

}  // namespace lightrig
