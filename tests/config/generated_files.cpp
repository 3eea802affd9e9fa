#include "tests/config/generated_files.h"

#include <algorithm>
#include <stdexcept>

#include "config/controller_profile.h"
#include "config/descriptions.h"
#include "config/read_rig.h"
#include "config/reference.h"

namespace lightrig::test {
namespace {

namespace fs = std::filesystem;

// Where the checkout lies is no part of a message.
std::string without_folder(std::string text) {
  const std::string prefix = faulty_folder().string() + "/";
  for (auto at = text.find(prefix); at != std::string::npos; at = text.find(prefix, at))
    text.erase(at, prefix.size());
  return text;
}

template <class R>
FaultyOutcome outcome_of(const R& read) {
  return {without_folder(to_text(read.diagnostics)), read.value.has_value(),
          has_error(read.diagnostics)};
}

/// The document with what stands between <!-- NAME: … --> and <!-- /NAME --> made anew.
std::string with_keys(std::string text, const std::string& name, const TableSpec& root) {
  const auto head = text.find("<!-- " + name + ":");
  const auto begin = text.find("-->\n\n", head);
  const auto end = text.find("<!-- /" + name + " -->", head);
  if (head == std::string::npos || begin == std::string::npos || end == std::string::npos)
    throw std::runtime_error("a document has no place for the " + name);
  return text.replace(begin + 5, end - begin - 5, key_reference(root));
}

}  // namespace

std::vector<GeneratedFile> generated_documents() {
  const fs::path docs = fs::path(source_dir) / "docs";
  TableSpec rig = rig_description();
  for (const TableSpec& table : session_tables())
    std::erase_if(rig.tables, [&](const TableSpec& t) { return t.name == table.name; });
  TableSpec session;
  session.tables = session_tables();
  const fs::path rig_file = docs / "rig_file.md", profile = docs / "controller_profile.md";
  return {
      {rig_file,
       with_keys(with_keys(bytes_of(rig_file), "rig keys", rig), "session keys", session)},
      {profile, with_keys(bytes_of(profile), "profile keys", profile_description())},
      {docs / "rig.schema.json", json_schema(rig_description(), "lightrig rig file")},
      {docs / "session.schema.json", json_schema(session_description(), "lightrig session file")},
      {docs / "controller.schema.json",
       json_schema(profile_description(), "lightrig controller profile")},
  };
}

std::vector<fs::path> faulty_files() {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(faulty_folder()))
    if (entry.path().extension() == ".toml") files.push_back(entry.path());
  std::ranges::sort(files);
  return files;
}

FaultyOutcome read_faulty(const fs::path& file) {
  const std::string name = file.filename().string();
  if (name.starts_with("profile_")) return outcome_of(read_profile(file));
  if (name.starts_with("rig_")) return outcome_of(read_rig(file));
  const Read<Rig> rig = read_rig(faulty_folder() / "base" / "rig.toml");
  return rig.value ? outcome_of(read_session(file, *rig.value)) : FaultyOutcome{};
}

}  // namespace lightrig::test
