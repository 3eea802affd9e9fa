#include "config/key_spec.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace lightrig {

const KeySpec* find_key(const TableSpec& table, const std::string& name) {
  const auto at = std::ranges::find(table.keys, name, &KeySpec::name);
  return at == table.keys.end() ? nullptr : &*at;
}

std::string range_phrase(const KeySpec& key) {
  const bool low = std::isfinite(key.range.least), high = std::isfinite(key.range.most);
  const std::string unit = *key.unit.text == '\0' ? "" : std::string(" ") + key.unit.text;
  const std::string over = key.range.without_least ? "> " : "≥ ";
  std::string text;
  if (low && high && !key.range.without_least)
    text = fmt::format("{} … {}", key.range.least, key.range.most);
  else if (low && high)
    text = fmt::format("> {} and ≤ {}", key.range.least, key.range.most);
  else if (low)
    text = fmt::format("{}{}", over, key.range.least);
  else if (high)
    text = fmt::format("≤ {}", key.range.most);
  return text.empty() ? text : text + unit;
}

namespace {

std::string kind_phrase(const KeySpec& key) {
  switch (key.kind) {
    case ValueKind::number:
      return "number";
    case ValueKind::integer:
      return "integer";
    case ValueKind::boolean:
      return "true or false";
    case ValueKind::text:
      return "text";
    case ValueKind::identifier:
      return "name (letters, digits, \".\", \"_\", \"-\")";
    case ValueKind::choice:
      return fmt::format("one of \"{}\"", fmt::join(key.choices, "\", \""));
    case ValueKind::path:
      return "path";
    case ValueKind::vector3:
      return "[x, y, z]";
    case ValueKind::channels:
      return "number or [red, green, blue]";
    case ValueKind::numbers:
      return "list of numbers";
    case ValueKind::integers:
      return "list of integers";
    case ValueKind::texts:
      return "list of texts";
    case ValueKind::vectors:
      return "list of [x, y, z]";
  }
  return "";
}

}  // namespace

std::string phrase(const KeySpec& key) {
  std::string text = kind_phrase(key);
  if (!key.sizes.empty()) text = fmt::format("{} ({})", text, fmt::join(key.sizes, " or "));
  const std::string range = range_phrase(key);
  if (!range.empty()) return text + ", " + range;
  if (*key.unit.text != '\0') return text + " [" + key.unit.text + "]";
  return text;
}

}  // namespace lightrig
