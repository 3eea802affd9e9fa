#include <fmt/format.h>

#include <algorithm>

#include "config/descriptions.h"
#include "config/documents.h"
#include "config/read_rig.h"

namespace lightrig {
namespace {

std::string place_text(const Place& place) {
  return fmt::format("{}:{}", place.source->file.filename().string(), place.line);
}

void print(const Section& s, std::vector<std::string>& lines) {
  for (const Cell& cell : s.cells)
    if (cell.value && cell.applies)
      lines.push_back(fmt::format("{}.{} = {}  # {}", s.path, cell.spec->name, to_toml(*cell.value),
                                  cell.given ? place_text(cell.place) : "default"));
  for (const auto& [key, value] : s.free_form)
    lines.push_back(
        fmt::format("{}.{} = {}  # {}", s.path, key, to_toml(Value(value)), place_text(s.place)));
  for (const Section& inner : s.sections) print(inner, lines);
}

}  // namespace

std::vector<std::string> effective_values(const Rig& rig, const SessionSpec& spec) {
  // Both texts were found valid when they became values; reading them again says where each value
  // stands without every value having to carry its place.
  Findings settled;
  std::vector<std::string> lines;
  const Source rig_source{rig.path, rig.text}, source{spec.path, spec.text};
  const auto root = read_document(rig_source, rig_description(), "", settled);
  std::optional<Section> own;
  if (!spec.path.empty()) own = read_document(source, session_description(), "", settled);
  if (!root) return lines;
  const auto session = effective_tables(own ? &*own : nullptr, *root, rig_source, settled);
  for (const Section& s : root->sections) {
    const bool of_session = std::ranges::any_of(
        session, [&](const Section* t) { return t->spec->name == s.spec->name; });
    if (!of_session) print(s, lines);
  }
  for (const Section* s : session) print(*s, lines);
  return lines;
}

}  // namespace lightrig
