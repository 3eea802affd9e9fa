#include <fmt/format.h>

#include <algorithm>

#include "config/read_value.h"
#include "config/section.h"
#include "config/suggest.h"
#include "core/check.h"

namespace lightrig {
namespace {

std::string joined(const std::string& path, const std::string& name) {
  return path.empty() ? name : path + "." + name;
}
// "[gantry]"; of the second of a list "[[gantry.axis]] 2".
std::string bracketed(const Section& section) {
  const std::string& path = section.path;
  if (path.empty()) return "the file";
  if (path.back() != ']') return "[" + path + "]";
  const auto at = path.rfind('[');
  return fmt::format("[[{}]] {}", path.substr(0, at), path.substr(at + 1, path.size() - at - 2));
}

// A doc sentence in the middle of another: "The most power." becomes "the most power".
std::string mid_sentence(std::string doc) {
  if (doc.ends_with('.')) doc.pop_back();
  const bool word = doc.size() > 1 && doc[0] >= 'A' && doc[0] <= 'Z' &&
                    (doc[1] == ' ' || (doc[1] >= 'a' && doc[1] <= 'z'));
  if (word) doc[0] = static_cast<char>(doc[0] - 'A' + 'a');
  return doc;
}

// "[lamp], [gantry]": every table under `table` that has a key of this name.
std::vector<std::string> tables_with(const std::string& key, const TableSpec& table,
                                     const std::string& path = {}) {
  std::vector<std::string> found;
  if (!path.empty() && find_key(table, key) != nullptr)
    found.push_back(table.repeat == Repeat::list    ? "[[" + path + "]]"
                    : table.repeat == Repeat::named ? "[" + path + ".NAME]"
                                                    : "[" + path + "]");
  for (const TableSpec& inner : table.tables) {
    const auto within = tables_with(key, inner, joined(path, inner.name));
    found.insert(found.end(), within.begin(), within.end());
  }
  return found;
}

const std::string& value_text(const Cell& cell) { return std::get<std::string>(*cell.value); }

// Whether a condition on a neighbour holds; unknown when the neighbour itself is unusable, and then
// nothing more is said about what hangs on it.
enum class Holds : std::uint8_t { no, yes, unknown };

Holds holds(const Condition& condition, const Section& section) {
  const auto at = std::ranges::find_if(
      section.cells, [&](const Cell& c) { return c.spec->name == condition.key; });
  CHECK(at != section.cells.end());  // a condition names a key that stands before it
  if (condition.values.empty()) return at->given ? Holds::yes : Holds::no;
  if (!at->value) return Holds::unknown;
  const std::string value =
      std::holds_alternative<bool>(*at->value) ? to_toml(*at->value) : value_text(*at);
  return std::ranges::find(condition.values, value) != condition.values.end() ? Holds::yes
                                                                              : Holds::no;
}

// "projection is "orthographic" (line 12)"
std::string neighbour(const Condition& condition, const Section& section) {
  const auto at = std::ranges::find_if(
      section.cells, [&](const Cell& c) { return c.spec->name == condition.key; });
  if (condition.values.empty())
    return at->given ? fmt::format("{} is given (line {})", condition.key, at->key_place.line)
                     : condition.key + " is not given";
  return fmt::format("{} is {} ({})", condition.key, to_toml(*at->value),
                     at->given ? fmt::format("line {}", at->place.line) : "by default");
}

std::string condition_text(const Condition& condition) {
  if (condition.values.empty()) return condition.key;
  return fmt::format("{} = \"{}\"", condition.key, fmt::join(condition.values, "\" or \""));
}

class SectionReader {
 public:
  SectionReader(const TableSpec& root, Findings& findings) : root_(root), findings_(findings) {}

  Section read(const TomlNode& node, const TableSpec& spec, const std::string& path,
               const Place& header, bool given) {
    Section section;
    section.spec = &spec;
    section.path = path;
    section.place = header;
    section.given = given;
    if (spec.free_form) {
      read_free_form(node, section);
      return section;
    }
    const std::vector<std::string> misspelt = refuse_unknown(node, section);
    for (const KeySpec& key : spec.keys)
      section.cells.push_back(read_key(node, key, section, misspelt));
    for (const auto& group : spec.exactly_one) check_exactly_one(group, section);
    for (const TableSpec& table : spec.tables) read_tables(node, table, section, misspelt);
    return section;
  }

 private:
  void read_free_form(const TomlNode& node, Section& section) {
    for (const TomlEntry& entry : node.entries) {
      const TomlNode& v = entry.value;
      std::string text = v.text;
      if (v.kind == TomlNode::Kind::integer) text = fmt::format("{}", v.integer);
      if (v.kind == TomlNode::Kind::number) text = fmt::format("{}", v.number);
      if (v.kind == TomlNode::Kind::boolean) text = v.boolean ? "true" : "false";
      if (v.kind == TomlNode::Kind::array || v.kind == TomlNode::Kind::table ||
          v.kind == TomlNode::Kind::date)
        findings_.error(v.place, fmt::format("{} must be a text, number, true or false, found {}",
                                             joined(section.path, entry.key), name_of(v.kind)));
      section.free_form.emplace_back(entry.key, text);
    }
    std::ranges::sort(section.free_form);
  }

  // The names that were probably meant: that they are missing need not be said as well.
  std::vector<std::string> refuse_unknown(const TomlNode& node, const Section& section) {
    const TableSpec& spec = *section.spec;
    std::vector<std::string> known, meant;
    for (const KeySpec& key : spec.keys) known.push_back(key.name);
    for (const TableSpec& table : spec.tables) known.push_back(table.name);
    for (const TomlEntry& entry : node.entries) {
      if (std::ranges::find(known, entry.key) != known.end()) continue;
      if (std::ranges::find(spec.foreign, entry.key) != spec.foreign.end()) {
        findings_.error(entry.place, fmt::format("[{}] {}", entry.key, spec.foreign_why));
        continue;
      }
      const bool is_table = entry.value.kind == TomlNode::Kind::table;
      const std::string near = nearest(entry.key, known);
      const bool taken = !near.empty() && node.find(near) != nullptr;
      if (!near.empty()) meant.push_back(near);
      findings_.error(entry.place,
                      fmt::format("unknown {} \"{}\" in {}", is_table ? "table" : "key", entry.key,
                                  bracketed(section)),
                      taken ? fmt::format("\"{}\" is given already", near)
                            : suggestion(entry.key, near, known));
    }
    return meant;
  }

  std::string suggestion(const std::string& key, const std::string& near,
                         const std::vector<std::string>& known) const {
    const std::vector<std::string> elsewhere = tables_with(key, root_);
    if (!elsewhere.empty() && elsewhere.size() <= 3)
      return fmt::format("it belongs in {}", fmt::join(elsewhere, " or "));
    if (!near.empty()) return "did you mean \"" + near + "\"?";
    return known.size() <= 12 ? fmt::format("known here: {}", fmt::join(known, ", ")) : "";
  }

  Cell read_key(const TomlNode& node, const KeySpec& key, const Section& section,
                const std::vector<std::string>& misspelt) {
    Cell cell;
    cell.spec = &key;
    cell.key_place = cell.place = section.place;
    const Holds legal = key.when ? holds(*key.when, section) : Holds::yes;
    cell.applies = legal != Holds::no;
    if (const TomlEntry* entry = node.find(key.name)) {
      cell.given = true;
      cell.key_place = entry->place;
      cell.place = entry->value.place;
      for (const TomlNode& item : entry->value.items) cell.items.push_back(item.place);
      cell.value = read_value(entry->value, key, joined(section.path, key.name), findings_);
      if (legal == Holds::no) {
        findings_.error(entry->place,
                        fmt::format("{} goes with {}, but {}", joined(section.path, key.name),
                                    condition_text(*key.when), neighbour(*key.when, section)));
        cell.value.reset();
      }
      return cell;
    }
    if (key.need == Need::defaulted) cell.value = default_value(key);
    const bool missing = key.need == Need::required && legal == Holds::yes &&
                         std::ranges::find(misspelt, key.name) == misspelt.end();
    if (missing && !in_a_group(key.name, *section.spec)) report_missing(key, section);
    return cell;
  }

  void report_missing(const KeySpec& key, const Section& section) {
    std::string message = fmt::format("{} lacks {} ({}): {}", bracketed(section), key.name,
                                      phrase(key), mid_sentence(key.doc));
    if (key.when) message += fmt::format("; needed because {}", neighbour(*key.when, section));
    if (!key.why.empty()) message += "; no default: " + key.why;
    findings_.error(section.place, message);
  }

  static bool in_a_group(const std::string& key, const TableSpec& spec) {
    return std::ranges::any_of(spec.exactly_one, [&](const auto& group) {
      return std::ranges::find(group, key) != group.end();
    });
  }

  void check_exactly_one(const std::vector<std::string>& group, const Section& section) {
    std::vector<const Cell*> given;
    for (const Cell& cell : section.cells)
      if (cell.given && std::ranges::find(group, cell.spec->name) != group.end())
        given.push_back(&cell);
    if (given.empty())
      findings_.error(section.place, fmt::format("{} needs exactly one of {}; none is given",
                                                 bracketed(section), fmt::join(group, ", ")));
    for (std::size_t i = 1; i < given.size(); ++i)
      findings_.error(given[i]->key_place,
                      fmt::format("{} conflicts with {} (line {}); give exactly one of {}",
                                  joined(section.path, given[i]->spec->name), given[0]->spec->name,
                                  given[0]->key_place.line, fmt::join(group, ", ")));
  }

  void read_tables(const TomlNode& node, const TableSpec& spec, Section& section,
                   const std::vector<std::string>& misspelt) {
    const Holds legal = spec.when ? holds(*spec.when, section) : Holds::yes;
    const TomlEntry* entry = node.find(spec.name);
    const std::string path = joined(section.path, spec.name);
    if (entry == nullptr) {
      if (spec.repeat == Repeat::once && spec.need == Need::defaulted)
        section.sections.push_back(read(TomlNode{}, spec, path, section.place, false));
      const bool meant = std::ranges::find(misspelt, spec.name) != misspelt.end();
      if (spec.need == Need::required && legal == Holds::yes && !meant)
        report_missing(spec, section);
      return;
    }
    if (legal == Holds::no) {
      findings_.error(header_of(*entry),
                      fmt::format("[{}] goes with {}, but {}", path, condition_text(*spec.when),
                                  neighbour(*spec.when, section)));
      return;
    }
    if (spec.repeat == Repeat::list) return read_list(*entry, spec, path, section);
    if (entry->value.kind != TomlNode::Kind::table) {
      findings_.error(entry->value.place, fmt::format("{} must be a table [{}], found {}", path,
                                                      path, name_of(entry->value.kind)));
      return;
    }
    if (spec.repeat == Repeat::named) return read_named(entry->value, spec, path, section);
    section.sections.push_back(read(entry->value, spec, path, header_of(*entry), true));
  }

  void report_missing(const TableSpec& spec, const Section& section) {
    const std::string path = joined(section.path, spec.name);
    const std::string header = spec.repeat == Repeat::list ? "[[" + path + "]]" : "[" + path + "]";
    std::string message = fmt::format("missing table {}: {}", header, mid_sentence(spec.doc));
    if (spec.when) message += fmt::format("; needed because {}", neighbour(*spec.when, section));
    findings_.error(section.place, message);
  }

  void read_list(const TomlEntry& entry, const TableSpec& spec, const std::string& path,
                 Section& section) {
    const bool tables = entry.value.kind == TomlNode::Kind::array &&
                        std::ranges::all_of(entry.value.items, [](const TomlNode& n) {
                          return n.kind == TomlNode::Kind::table;
                        });
    if (!tables) {
      findings_.error(entry.value.place, fmt::format("{} must be a list of tables [[{}]], found {}",
                                                     path, path, name_of(entry.value.kind)));
      return;
    }
    int i = 0;
    for (const TomlNode& item : entry.value.items)
      section.sections.push_back(
          read(item, spec, fmt::format("{}[{}]", path, ++i), item.place, true));
  }

  void read_named(const TomlNode& node, const TableSpec& spec, const std::string& path,
                  Section& section) {
    static const KeySpec name_rule{.name = "name", .kind = ValueKind::identifier};
    for (const TomlEntry& entry : node.entries) {
      if (entry.value.kind != TomlNode::Kind::table) {
        findings_.error(entry.place,
                        fmt::format("[{0}] holds named tables: write [{0}.NAME]; found {1} \"{2}\"",
                                    path, name_of(entry.value.kind), entry.key));
        return;  // the rest is most likely the same mistake
      }
      TomlNode name;
      name.kind = TomlNode::Kind::text;
      name.text = entry.key;
      name.place = entry.place;
      read_value(name, name_rule, fmt::format("the name of [{}.{}]", path, entry.key), findings_);
      section.sections.push_back(
          read(entry.value, spec, joined(path, entry.key), header_of(entry), true));
      section.sections.back().name = entry.key;
    }
  }

  // The place of a table's header; a table that only its sub-tables imply has none of its own.
  static Place header_of(const TomlEntry& entry) {
    return entry.value.place.line > 0 ? entry.value.place : entry.place;
  }

  const TableSpec& root_;
  Findings& findings_;
};

}  // namespace

Section read_section(const TomlNode& document, const TableSpec& description, const Source& source,
                     Findings& findings) {
  return SectionReader(description, findings)
      .read(document, description, "", Place{&source, 0, 0, 1}, true);
}

}  // namespace lightrig
