#pragma once

#include <string>
#include <string_view>

namespace lightrig {

/// True for the second and later bytes of a UTF-8 code point.
inline bool is_continuation(char c) { return (static_cast<unsigned char>(c) & 0xC0U) == 0x80U; }

inline int code_points_in(std::string_view text) {
  int n = 0;
  for (const char c : text) n += is_continuation(c) ? 0 : 1;
  return n;
}

/// `count` code points of a text from the `first`-th, counted from 0; less where it ends.
inline std::string_view code_points(std::string_view text, int first, int count) {
  const auto offset = [text](std::size_t from, int n) {
    for (; from < text.size(); ++from)
      if (!is_continuation(text[from]) && n-- == 0) break;
    return from;
  };
  const std::size_t begin = offset(0, first);
  return text.substr(begin, offset(begin, count) - begin);
}

/// The n-th line of a text, from 1, without its end (LF or CRLF); "" past the end.
inline std::string line_of(std::string_view text, int n) {
  for (; n > 1; --n) {
    const auto end = text.find('\n');
    if (end == std::string_view::npos) return {};
    text.remove_prefix(end + 1);
  }
  text = text.substr(0, text.find('\n'));
  if (!text.empty() && text.back() == '\r') text.remove_suffix(1);
  return std::string(text);
}

}  // namespace lightrig
