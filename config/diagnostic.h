#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace lightrig {

/// One thing wrong with a file, and where.
struct Diagnostic {
  enum class Severity : std::uint8_t { error, warning };
  Severity severity = Severity::error;
  std::filesystem::path file;
  int line = 0, column = 0;  ///< from 1, columns in code points; 0 when the whole file is meant
  std::string message;       ///< what is wrong and what is expected, with units and numbers
  std::string suggestion;    ///< "did you mean …", or ""
  int length = 1;            ///< code points to underline
  std::string source_line;   ///< the line meant, so that a message can be shown without its file
};

/// "file:line:col: error: message; did you mean …", then the source line and a caret. The line is
/// the diagnostic's own; where it has none it is taken from `source_text`.
std::string to_text(const Diagnostic& diagnostic, const std::string& source_text = {});

/// All of them, one after the other, in order.
std::string to_text(std::span<const Diagnostic> diagnostics);

bool has_error(std::span<const Diagnostic> diagnostics);

}  // namespace lightrig
