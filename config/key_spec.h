#pragma once

#include <cstdint>
#include <limits>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

namespace lightrig {

/// A unit as it ends a key's name. Values are stored as written; `si` turns them into SI or radians
/// when they are taken out.
struct Unit {
  const char* suffix;  ///< "_mm"
  const char* text;    ///< "mm", for messages and docs
  double si;           ///< factor to SI, or radians
};
namespace units {
inline constexpr double degree = std::numbers::pi / 180;
inline constexpr Unit none{"", "", 1};
inline constexpr Unit m{"_m", "m", 1};
inline constexpr Unit mm{"_mm", "mm", 1e-3};
inline constexpr Unit deg{"_deg", "°", degree};
inline constexpr Unit deg_per_s{"_deg_per_s", "°/s", degree};
inline constexpr Unit deg_per_s2{"_deg_per_s2", "°/s²", degree};
inline constexpr Unit mm_per_s{"_mm_per_s", "mm/s", 1e-3};
inline constexpr Unit mm_per_s2{"_mm_per_s2", "mm/s²", 1e-3};
inline constexpr Unit s{"_s", "s", 1};
inline constexpr Unit ms{"_ms", "ms", 1e-3};
inline constexpr Unit minutes{"minutes", "min", 60};
inline constexpr Unit hz{"_hz", "Hz", 1};
inline constexpr Unit px{"_px", "px", 1};
inline constexpr Unit px_per_m{"_px_per_m", "px/m", 1};
inline constexpr Unit bytes{"_bytes", "byte", 1};
inline constexpr Unit percent{"_percent", "%", 1};
inline constexpr Unit dn{"_dn", "DN", 1};
inline constexpr Unit e{"_e", "e⁻", 1};
inline constexpr Unit e_per_dn{"_e_per_dn", "e⁻/DN", 1};
inline constexpr Unit e_per_s{"_e_per_s", "e⁻/s", 1};
inline constexpr Unit response{"_e_m2_sr_per_j", "e⁻/s per W m⁻² sr⁻¹", 1};
inline constexpr Unit w_per_sr{"_w_per_sr", "W/sr", 1};
inline constexpr Unit w_per_m2{"_w_per_m2", "W/m²", 1};
inline constexpr Unit radiance{"_w_per_m2_sr", "W m⁻² sr⁻¹", 1};
inline constexpr Unit per_sr{"_per_sr", "1/sr", 1};
inline constexpr Unit celsius{"_c", "°C", 1};
inline constexpr Unit per_frame{"_per_frame", "packets a frame", 1};
inline constexpr Unit per_hour{"_percent_per_hour", "%/h", 1};
inline constexpr Unit c_per_count{"_c_per_count", "°C per count", 1};
inline constexpr Unit per_deg{"_per_deg", "1/°", 1 / degree};
inline constexpr Unit per_mm{"_per_mm", "1/mm", 1e3};
}  // namespace units

enum class ValueKind : std::uint8_t {
  number,      ///< finite, unless the range reaches infinity
  integer,     ///< within 64 bits
  boolean,     ///<
  text,        ///<
  identifier,  ///< letters, digits, ".", "_", "-"; begins with a letter or digit; at most 64
  choice,      ///< one of KeySpec::choices
  path,        ///< relative to the file it stands in
  vector3,     ///< [x, y, z]
  channels,    ///< one number for all channels, or [red, green, blue]
  numbers,     ///< list of numbers
  integers,    ///< list of integers
  texts,       ///< list of texts
  vectors,     ///< list of [x, y, z]
};

/// What a number may be, in the key's own unit; lists: every item.
struct Range {
  double least = -std::numeric_limits<double>::infinity();
  double most = std::numeric_limits<double>::infinity();
  bool without_least = false;  ///< least itself is not allowed
  bool infinite = false;       ///< "inf" is allowed
};
inline constexpr Range any_number{};
inline constexpr Range positive{0, std::numeric_limits<double>::infinity(), true};
inline constexpr Range fraction{0, 1};
inline constexpr Range not_negative{0};

/// A key or table is legal only beside a certain neighbour: `key` (of the same table; for a table,
/// of the table above it) has one of `values`, or, with no values, is given at all.
struct Condition {
  std::string key;
  std::vector<std::string> values;
};

enum class Need : std::uint8_t {
  required,   ///< absent is an error
  optional,   ///< absent means none
  defaulted,  ///< absent means KeySpec::fallback; a table: all its keys' defaults
};

/// All that is known of one key: it drives the reader, `check --print`, docs/rig_file.md and the
/// JSON schema alike.
struct KeySpec {
  std::string name = {};
  ValueKind kind = ValueKind::number;
  Unit unit = units::none;
  Range range = any_number;
  Need need = Need::required;
  std::string fallback = {};  ///< defaulted: the default, as one writes it in TOML
  std::vector<std::string> choices = {};
  std::vector<int> sizes = {};  ///< lists: lengths allowed; empty: at least one item
  std::optional<Condition> when = {};
  std::string doc = {};  ///< one sentence or two, for a technician
  std::string why = {};  ///< required: why there is no default, where a person may ask
};

enum class Repeat : std::uint8_t {
  once,   ///< [name]
  list,   ///< [[name]], at least one when required
  named,  ///< [name.ANYTHING]: the person chooses the names (identifiers)
};

struct TableSpec {
  std::string name = {};
  Repeat repeat = Repeat::once;
  Need need = Need::required;
  std::optional<Condition> when = {};
  std::string doc = {};
  std::vector<KeySpec> keys = {};
  std::vector<TableSpec> tables = {};
  std::vector<std::vector<std::string>> exactly_one =
      {};                                 ///< of these keys exactly one must be given
  std::vector<std::string> foreign = {};  ///< tables of another kind of file …
  std::string foreign_why = {};           ///< … and why they may not stand in this one
  bool free_form = false;  ///< any keys, with text, number or boolean values, in name order
};

const KeySpec* find_key(const TableSpec& table, const std::string& name);

/// "number, 0.01 … 10 m", "one of "a", "b"", …: type, unit and range in a phrase.
std::string phrase(const KeySpec& key);
/// The same of one item of a list; of a key that is no list, its phrase.
std::string item_phrase(const KeySpec& key);
/// "0.01 … 10 m", "> 0", "≥ 1"; "" when anything goes.
std::string range_phrase(const KeySpec& key);
/// " m", "°", "": a unit as it follows a number.
std::string after_number(const Unit& unit);
/// "a number", "an integer", "one of …", "[x, y, z]": a phrase as it follows "must be".
std::string with_article(const std::string& phrase);

}  // namespace lightrig
