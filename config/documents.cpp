#include "config/documents.h"

#include <fmt/format.h>

#include "config/descriptions.h"

namespace lightrig {

std::optional<Section> read_document(const Source& source, const TableSpec& description,
                                     const std::string& needs, Findings& findings) {
  const auto tree = parse_toml(source);
  if (!tree) {
    findings.add(tree.error());
    return std::nullopt;
  }
  if (tree->entries.empty()) {
    findings.error(Place{&source, 0, 0, 1}, "the file is empty; it needs " + needs);
    return std::nullopt;
  }
  return read_section(*tree, description, source, findings);
}

std::vector<const Section*> effective_tables(const Section* session, const Section& rig,
                                             const Source& said_in, Findings& findings) {
  std::vector<const Section*> tables;
  for (const TableSpec& spec : session_tables()) {
    const Section* own = session == nullptr ? nullptr : session->find(spec.name);
    const Section* defaults = rig.find(spec.name);
    if (own != nullptr && own->given)
      tables.push_back(own);
    else if (defaults != nullptr)
      tables.push_back(defaults);
    else
      findings.error(Place{&said_in, 0, 0, 1},
                     fmt::format("no table [{}], neither in a session file nor in the rig file: {}",
                                 spec.name, spec.doc));
  }
  return tables;
}

}  // namespace lightrig
