#include "config/diagnostic.h"

#include <fmt/format.h>

#include <algorithm>

#include "config/utf8.h"

namespace lightrig {
namespace {

// Blanks as wide as the line up to the caret: a tab stays a tab, so that the caret stands right.
std::string indent_like(const std::string& line, int code_points) {
  std::string indent;
  int seen = 0;
  for (const char c : line) {
    if (is_continuation(c)) continue;
    if (seen++ == code_points) break;
    indent += c == '\t' ? '\t' : ' ';
  }
  indent.append(static_cast<std::size_t>(std::max(0, code_points - seen)), ' ');
  return indent;
}

// What stands between the first and last words of a long message, or around a caret, says nothing.
constexpr int widest_line = 160;
constexpr int longest_message = 400;
constexpr const char* ellipsis = "…";

std::string shortened(const std::string& message) {
  const int all = code_points_in(message);
  if (all <= longest_message) return message;
  constexpr int half = longest_message / 2;
  return fmt::format("{}{}{}", code_points(message, 0, half), ellipsis,
                     code_points(message, all - half, half));
}

/// The part of a line that is shown, and the caret's column in it.
struct Window {
  std::string line;
  int column;
};

Window window_of(const std::string& line, int column) {
  const int all = code_points_in(line);
  if (all <= widest_line) return {line, column};
  const int first = std::clamp(column - 1 - widest_line / 4, 0, all - widest_line);
  std::string shown(code_points(line, first, widest_line));
  if (first + widest_line < all) shown += ellipsis;
  if (first == 0) return {shown, column};
  return {ellipsis + shown, column - first + 1};
}

}  // namespace

std::string to_text(const Diagnostic& d, const std::string& source_text) {
  std::string text = d.file.string();
  if (d.line > 0) text += fmt::format(":{}:{}", d.line, std::max(1, d.column));
  text += d.severity == Diagnostic::Severity::error ? ": error: " : ": warning: ";
  text += shortened(d.message);
  if (!d.suggestion.empty()) text += "; " + d.suggestion;
  text += '\n';
  if (d.line <= 0) return text;

  const std::string whole = d.source_line.empty() ? line_of(source_text, d.line) : d.source_line;
  if (whole.empty()) return text;
  const auto [line, column] = window_of(whole, std::max(1, d.column));
  const int room = std::max(1, code_points_in(line) - column + 1);
  const int length = std::clamp(d.length, 1, room);
  text += fmt::format("{:5} | {}\n", d.line, line);
  text += fmt::format("      | {}^{}\n", indent_like(line, column - 1),
                      std::string(static_cast<std::size_t>(length - 1), '~'));
  return text;
}

std::string to_text(std::span<const Diagnostic> diagnostics) {
  std::string text;
  for (const Diagnostic& d : diagnostics) text += to_text(d);
  return text;
}

bool has_error(std::span<const Diagnostic> diagnostics) {
  return std::ranges::any_of(
      diagnostics, [](const Diagnostic& d) { return d.severity == Diagnostic::Severity::error; });
}

}  // namespace lightrig
