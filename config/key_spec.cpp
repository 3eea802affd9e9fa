#include "config/key_spec.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <string_view>

namespace lightrig {

const KeySpec* find_key(const TableSpec& table, const std::string& name) {
  const auto at = std::ranges::find(table.keys, name, &KeySpec::name);
  return at == table.keys.end() ? nullptr : &*at;
}

std::string range_phrase(const KeySpec& key) {
  const bool low = std::isfinite(key.range.least), high = std::isfinite(key.range.most);
  const std::string unit = after_number(key.unit);
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

namespace {

std::string with_range(const std::string& kind, const KeySpec& key) {
  const std::string range = range_phrase(key);
  if (!range.empty()) return kind + ", " + range;
  return *key.unit.text == '\0' ? kind : kind + " [" + key.unit.text + "]";
}

}  // namespace

std::string phrase(const KeySpec& key) {
  std::string kind = kind_phrase(key);
  if (!key.sizes.empty()) kind = fmt::format("{} ({})", kind, fmt::join(key.sizes, " or "));
  return with_range(kind, key);
}

std::string item_phrase(const KeySpec& key) {
  switch (key.kind) {
    case ValueKind::vector3:
    case ValueKind::channels:
    case ValueKind::numbers:
    case ValueKind::vectors:
      return with_range("number", key);
    case ValueKind::integers:
      return with_range("integer", key);
    case ValueKind::texts:
      return "text";
    default:
      return phrase(key);
  }
}

std::string after_number(const Unit& unit) {
  const std::string_view text(unit.text);
  if (text.empty()) return {};
  return fmt::format("{}{}", text.starts_with("°") ? "" : " ", text);
}

std::string with_article(const std::string& phrase) {
  const bool none =
      phrase.starts_with("one of") || phrase.starts_with("true") || phrase.starts_with("[");
  if (none) return phrase;
  return fmt::format("{} {}", phrase.starts_with("integer") ? "an" : "a", phrase);
}

}  // namespace lightrig
