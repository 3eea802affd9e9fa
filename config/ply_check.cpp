#include "config/ply_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <charconv>
#include <cstdint>
#include <cstring>
#include <sstream>
#include <string_view>
#include <vector>

namespace lightrig {
namespace {

struct Property {
  bool list = false;
  bool names_vertices = false;
  int count_bytes = 0;  ///< list: size of its length
  int item_bytes = 0;
};
struct Element {
  std::string name;
  std::int64_t count = 0;
  std::vector<Property> properties;
};
enum class Encoding : std::uint8_t { ascii, little, big };
struct Head {
  Encoding encoding = Encoding::ascii;
  std::vector<Element> elements;
  std::size_t body = 0;  ///< where the elements begin

  std::int64_t count_of(std::string_view name) const {
    const auto at = std::ranges::find(elements, name, &Element::name);
    return at == elements.end() ? 0 : at->count;
  }
};

/// 0: no type of PLY.
int bytes_of(const std::string& type) {
  if (type == "char" || type == "uchar" || type == "int8" || type == "uint8") return 1;
  if (type == "short" || type == "ushort" || type == "int16" || type == "uint16") return 2;
  if (type == "double" || type == "float64") return 8;
  if (type == "int" || type == "uint" || type == "int32" || type == "uint32") return 4;
  if (type == "float" || type == "float32") return 4;
  return 0;
}

/// Of any bytes, as much as may stand in a message.
std::string printable(const std::string& word) {
  std::string out;
  for (const char c : word.substr(0, 30)) out += c >= ' ' && c <= '~' ? c : '?';
  return out;
}

/// What is wrong with the lines of a header, or nothing. An importer that goes on behind a line it
/// does not know may not come back.
std::optional<std::string> unknown_line(std::string_view text) {
  constexpr std::array<std::string_view, 7> known{"ply",     "format",   "comment",   "obj_info",
                                                  "element", "property", "end_header"};
  std::istringstream lines{std::string(text)};
  int number = 1;
  for (std::string line; std::getline(lines, line); ++number) {
    std::istringstream words(line);
    std::string what, type, count, item, name;
    words >> what >> type;
    if (what == "end_header") return std::nullopt;
    if (what == "property") {
      // An importer may take a type it does not know for one of another size.
      const bool list = type == "list";
      if (list) words >> count >> item;
      words >> name;
      for (const std::string& one : list ? std::vector{count, item} : std::vector{type})
        if (bytes_of(one) == 0)
          return fmt::format("line {} of its header: '{}' is no type of a property", number,
                             printable(one));
      if (name.empty())
        return fmt::format("line {} of its header: the property has no name", number);
    }
    if (std::ranges::find(known, what) == known.end() && !what.empty())
      return fmt::format("line {} of its header begins with '{}', which no PLY header has", number,
                         printable(what));
  }
  return "it has no PLY header";
}

std::optional<Head> read_head(std::string_view text) {
  constexpr std::string_view closing = "end_header";
  const auto end = text.find(closing);
  if (!text.starts_with("ply") || end == std::string_view::npos) return std::nullopt;
  const auto line_end = text.find('\n', end);
  if (line_end == std::string_view::npos) return std::nullopt;
  Head head;
  head.body = line_end + 1;
  std::istringstream lines{std::string(text.substr(0, end))};
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string what, a, b, c, d;
    words >> what >> a >> b >> c >> d;
    if (what == "format")
      head.encoding = a == "binary_little_endian" ? Encoding::little
                      : a == "binary_big_endian"  ? Encoding::big
                                                  : Encoding::ascii;
    if (what == "element") {
      Element element{a, 0, {}};
      std::from_chars(b.data(), b.data() + b.size(), element.count);
      head.elements.push_back(std::move(element));
    }
    if (what == "property" && !head.elements.empty())
      head.elements.back().properties.push_back(
          a == "list" ? Property{true, d.starts_with("vertex_ind"), bytes_of(b), bytes_of(c)}
                      : Property{false, false, 0, bytes_of(a)});
  }
  return head;
}

// Walks over the values of a body; false, or nothing, where it ends too early.
class Body {
 public:
  Body(std::string_view text, Encoding encoding) : left_(text), encoding_(encoding) {}

  bool skip(std::int64_t values, int bytes_each) {
    if (encoding_ == Encoding::ascii) {
      for (; values > 0; --values)
        if (word().empty()) return false;
      return true;
    }
    const auto n = static_cast<std::uint64_t>(values) * static_cast<std::uint64_t>(bytes_each);
    if (n > left_.size()) return false;
    left_.remove_prefix(n);
    return true;
  }

  /// Of text, an element's values are those of its line, as importers read them; binary ones have
  /// none. False where there is no further line, or a byte in it that no text has.
  bool begin_element() {
    if (encoding_ != Encoding::ascii) return true;
    const auto end = std::min(left_.find('\n'), left_.size());
    line_ = left_.substr(0, end);
    left_.remove_prefix(std::min(end + 1, left_.size()));
    return std::ranges::all_of(line_, [](char c) {
      return c == '\t' || c == '\r' || static_cast<unsigned char>(c) >= 0x20;
    });
  }

  std::optional<std::int64_t> read_count(int bytes) {
    const auto value = read_whole(bytes);
    // More items than bytes can only be a mistake; it must not overflow what skip() multiplies.
    const std::size_t rest = encoding_ == Encoding::ascii ? line_.size() : left_.size();
    if (!value || *value < 0 || static_cast<std::uint64_t>(*value) > rest) return std::nullopt;
    return value;
  }

  // A whole number of up to 4 bytes, as unsigned ones are: a negative index is far beyond the last.
  std::optional<std::int64_t> read_whole(int bytes) {
    if (encoding_ == Encoding::ascii) {
      std::int64_t number = 0;
      const std::string_view text = word();
      const auto [at, error] = std::from_chars(text.data(), text.data() + text.size(), number);
      if (text.empty() || error != std::errc{}) return std::nullopt;
      return number;
    }
    const auto size = static_cast<std::size_t>(bytes);
    if (size > left_.size()) return std::nullopt;
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < size; ++i) {
      const std::size_t at = encoding_ == Encoding::big ? i : size - 1 - i;
      value = value << 8U | static_cast<unsigned char>(left_[at]);
    }
    left_.remove_prefix(size);
    return static_cast<std::int64_t>(value);
  }

 private:
  std::string_view word() {
    constexpr const char* blanks = " \t\r";
    const auto begin = std::min(line_.find_first_not_of(blanks), line_.size());
    line_.remove_prefix(begin);
    const auto end = std::min(line_.find_first_of(blanks), line_.size());
    const std::string_view found = line_.substr(0, end);
    line_.remove_prefix(end);
    return found;
  }

  std::string_view left_;
  std::string_view line_;  ///< of text: what is left of the element's
  Encoding encoding_;
};

std::string counted(std::int64_t n, const char* one, const char* many) {
  return fmt::format("{} {}", n, n == 1 ? one : many);
}

struct Walked {
  bool whole = false;
  std::optional<std::int64_t> stray;  ///< the index of a vertex that there is not
};

Walked walk(const Element& element, std::int64_t vertices, Body& body) {
  if (!body.begin_element()) return {};
  for (const Property& property : element.properties) {
    std::int64_t values = 1;
    if (property.list) {
      const auto count = body.read_count(property.count_bytes);
      if (!count) return {};
      values = *count;
    }
    if (!property.names_vertices) {
      if (!body.skip(values, property.item_bytes)) return {};
      continue;
    }
    for (; values > 0; --values) {
      const auto index = body.read_whole(property.item_bytes);
      if (!index) return {};
      if (*index < 0 || *index >= vertices) return {true, index};
    }
  }
  return {true, {}};
}

}  // namespace

std::optional<std::string> ply_shortfall(std::span<const std::byte> bytes) {
  const std::string_view text(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  const auto head = read_head(text);
  if (!head) return "it has no PLY header";
  if (auto unknown = unknown_line(text.substr(0, head->body))) return unknown;
  const std::int64_t vertices = head->count_of("vertex"), faces = head->count_of("face");
  if (vertices < 1 || faces < 1)
    return fmt::format("its header promises {} and {}; a surface is needed",
                       counted(vertices, "vertex", "vertices"), counted(faces, "face", "faces"));
  Body body(text.substr(head->body), head->encoding);
  for (const Element& element : head->elements) {
    if (element.count == 0) continue;
    if (element.properties.empty())
      return fmt::format("its header says of no property that its element '{}' has",
                         printable(element.name));
    for (std::int64_t i = 0; i < element.count; ++i) {
      const Walked walked = walk(element, vertices, body);
      if (!walked.whole)
        return fmt::format(
            "its header promises {} and {}, but its {} bytes end before {} {}, or its line is not "
            "whole: truncated? Copy it again from where it came from",
            counted(vertices, "vertex", "vertices"), counted(faces, "face", "faces"), bytes.size(),
            element.name, i + 1);
      if (walked.stray)
        return fmt::format("its {} {} names vertex {}, counted from 0, but there are only {}",
                           element.name, i + 1, *walked.stray, vertices);
    }
  }
  return std::nullopt;
}

}  // namespace lightrig
