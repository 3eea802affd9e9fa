#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <tl/expected.hpp>
#include <vector>

#include "config/diagnostic.h"
#include "core/result.h"

namespace lightrig {

/// A text with the file it came from; what every place in it refers to.
struct Source {
  std::filesystem::path file;
  std::string text;  ///< its exact bytes
};

/// A stretch of one line of a source.
struct Place {
  const Source* source = nullptr;
  int line = 0, column = 0;  ///< from 1, columns in code points; 0 for the whole file
  int length = 1;            ///< [code points]
};

struct TomlEntry;

/// A TOML document as plain values with their places; the rest of the room never sees the library.
struct TomlNode {
  enum class Kind : std::uint8_t { table, array, text, integer, number, boolean, date };
  Kind kind = Kind::table;
  Place place;
  std::string text;  ///< text: its value
  std::int64_t integer = 0;
  double number = 0;  ///< number, and integer as a number
  bool boolean = false;
  std::vector<TomlEntry> entries;  ///< table: in the order of the file
  std::vector<TomlNode> items;     ///< array

  const TomlEntry* find(const std::string& key) const;
};

struct TomlEntry {
  std::string key;
  Place place;  ///< of the key
  TomlNode value;
};

/// The bytes of a regular file of at most 16 MiB. Errors, as a diagnostic of the whole file:
/// absent, a directory, unreadable, too large.
tl::expected<std::string, Diagnostic> read_text(const std::filesystem::path& file);

/// Parses TOML 1.0. The source must outlive the tree. Stops at the first syntax error.
tl::expected<TomlNode, Diagnostic> parse_toml(const Source& source);

/// "a text", "an integer", …: for messages that say what was found.
const char* name_of(TomlNode::Kind kind);

}  // namespace lightrig
