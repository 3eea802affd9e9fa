#pragma once

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "config/diagnostic.h"
#include "tests/paths.h"

namespace lightrig::test {

/// A file of the checkout that is made from what the product says, and what it is to hold. Tests
/// compare; tests/write_generated.cpp, a program of its own, writes: no test passes by having
/// written what it expects.
struct GeneratedFile {
  std::filesystem::path file;
  std::string text;
};

/// The documents' lists of keys and the schemas, from the reader's own descriptions.
std::vector<GeneratedFile> generated_documents();

inline const std::filesystem::path& faulty_folder() {
  static const auto folder = std::filesystem::path(source_dir) / "config" / "faulty";
  return folder;
}
std::vector<std::filesystem::path> faulty_files();
/// What reading one of them gives; paths are relative to their folder.
struct FaultyOutcome {
  std::string text;
  bool has_value = false, has_error = false;
};
FaultyOutcome read_faulty(const std::filesystem::path& file);

inline std::string bytes_of(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

}  // namespace lightrig::test
