#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace lightrig {

/// One thing wrong with a file, and where.
struct Diagnostic {
  enum class Severity : std::uint8_t { error, warning };
  Severity severity = Severity::error;
  std::filesystem::path file;
  int line = 0, column = 0;  ///< from 1; 0 when the whole file is meant
  std::string message;       ///< what is wrong and what is expected, with units and numbers
  std::string suggestion;    ///< "did you mean …", or ""
};

/// "file:line:col: error: message; did you mean …", then the source line and a caret.
std::string to_text(const Diagnostic& diagnostic, const std::string& source_text);

}  // namespace lightrig
