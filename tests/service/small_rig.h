#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "config/read_rig.h"
#include "tests/paths.h"
#include "tests/rig_text.h"

namespace lightrig {

/// The demo's rig made small: a sphere, and a clock that jumps. A whole session takes about a
/// second.
inline std::string small_rig_text() {
  test::RigText text("demo.toml");
  text.make_small();
  text.set("clock_rate", "inf");
  text.set_last("shape", "\"sphere\"");
  return text.text();
}

/// A rig file in `folder`, and what it is read as.
inline Rig small_rig(const std::filesystem::path& folder) {
  const std::filesystem::path path = folder / "rig.toml";
  std::filesystem::create_directories(folder / "controllers");
  std::filesystem::copy(
      std::filesystem::path(lightrig::test::source_dir) / "config" / "controllers",
      folder / "controllers",
      std::filesystem::copy_options::recursive | std::filesystem::copy_options::overwrite_existing);
  std::ofstream(path) << small_rig_text();
  auto read = read_rig(path);
  for (const Diagnostic& one : read.diagnostics)
    if (one.severity == Diagnostic::Severity::error) ADD_FAILURE() << to_text(one, read.text);
  if (!read.value) return {};
  read.value->session_root = folder / "sessions";
  return std::move(*read.value);
}

}  // namespace lightrig
