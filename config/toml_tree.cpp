#include "config/toml_tree.h"

#include <toml++/toml.h>
#include <algorithm>
#include <string_view>

#include "config/read_bytes.h"
#include "config/utf8.h"

namespace lightrig {
namespace {

constexpr std::size_t largest_file = std::size_t{16}
                                     << 20;  // [byte]; a rig file of megabytes is a mistake

Place place_of(const Source& source, const toml::source_region& region) {
  Place place{&source, static_cast<int>(region.begin.line), static_cast<int>(region.begin.column),
              1};
  if (region.end.line == region.begin.line && region.end.column > region.begin.column)
    place.length = static_cast<int>(region.end.column - region.begin.column);
  return place;
}

TomlNode copy(const Source& source, const toml::node& node);

TomlNode copy_table(const Source& source, const toml::table& table) {
  TomlNode out;
  for (const auto& [key, value] : table)
    out.entries.push_back(
        {std::string(key.str()), place_of(source, key.source()), copy(source, value)});
  // The library sorts by name; a person reads from the top.
  std::ranges::stable_sort(out.entries, [](const TomlEntry& a, const TomlEntry& b) {
    return std::pair(a.place.line, a.place.column) < std::pair(b.place.line, b.place.column);
  });
  return out;
}

TomlNode copy(const Source& source, const toml::node& node) {
  TomlNode out;
  if (const toml::table* table = node.as_table()) out = copy_table(source, *table);
  if (const toml::array* array = node.as_array()) {
    out.kind = TomlNode::Kind::array;
    for (const toml::node& item : *array) out.items.push_back(copy(source, item));
  }
  if (const auto* text = node.as_string()) {
    out.kind = TomlNode::Kind::text;
    out.text = text->get();
  }
  if (const auto* integer = node.as_integer()) {
    out.kind = TomlNode::Kind::integer;
    out.integer = integer->get();
    out.number = static_cast<double>(integer->get());
  }
  if (const auto* number = node.as_floating_point()) {
    out.kind = TomlNode::Kind::number;
    out.number = number->get();
  }
  if (const auto* boolean = node.as_boolean()) {
    out.kind = TomlNode::Kind::boolean;
    out.boolean = boolean->get();
  }
  if (node.is_date() || node.is_time() || node.is_date_time()) out.kind = TomlNode::Kind::date;
  out.place = place_of(source, node.source());
  return out;
}

Diagnostic whole_file(const std::filesystem::path& file, std::string message) {
  Diagnostic d;
  d.file = file;
  d.message = std::move(message);
  return d;
}

}  // namespace

const TomlEntry* TomlNode::find(const std::string& key) const {
  const auto at = std::ranges::find(entries, key, &TomlEntry::key);
  return at == entries.end() ? nullptr : &*at;
}

tl::expected<std::string, Diagnostic> read_text(const std::filesystem::path& file) {
  const auto bytes = read_bytes(file);
  if (!bytes)
    return tl::unexpected(whole_file(file, "cannot read this file: " + bytes.error().message));
  if (bytes->size() > largest_file)
    return tl::unexpected(whole_file(file, "cannot read this file: it is larger than 16 MiB"));
  return std::string(reinterpret_cast<const char*>(bytes->data()), bytes->size());
}

tl::expected<TomlNode, Diagnostic> parse_toml(const Source& source) {
  // The library throws; what it throws ends here.
  try {
    return copy_table(source, toml::parse(std::string_view(source.text), source.file.string()));
  } catch (const toml::parse_error& error) {
    Diagnostic d = whole_file(source.file, "not TOML: " + std::string(error.description()));
    const Place place = place_of(source, error.source());
    d.line = place.line;
    d.column = place.column;
    d.source_line = line_of(source.text, place.line);
    return tl::unexpected(d);
  }
}

const char* name_of(TomlNode::Kind kind) {
  switch (kind) {
    case TomlNode::Kind::table:
      return "a table";
    case TomlNode::Kind::array:
      return "a list";
    case TomlNode::Kind::text:
      return "a text";
    case TomlNode::Kind::integer:
      return "an integer";
    case TomlNode::Kind::number:
      return "a number";
    case TomlNode::Kind::boolean:
      return "true or false";
    case TomlNode::Kind::date:
      return "a date or time";
  }
  return "something else";
}

}  // namespace lightrig
