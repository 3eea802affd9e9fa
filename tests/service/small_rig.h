#pragma once

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <regex>
#include <sstream>
#include <string>

#include "config/read_rig.h"
#include "tests/paths.h"

namespace lightrig {

/// The demo's rig made small: a sphere on a few pixels, few candidates, few materials, a clock that
/// jumps. A whole session takes about a second.
inline std::string small_rig_text() {
  std::ifstream in(std::filesystem::path(lightrig::test::source_dir) / "config" / "demo.toml");
  std::stringstream bytes;
  bytes << in.rdbuf();
  std::string text = bytes.str();
  const auto set = [&](const std::string& key, const std::string& value) {
    const std::string before = text;
    // The last of its name: keep-out volumes have shapes too, the object comes after them.
    const auto at = text.rfind("\n" + key + " = ");
    if (at != std::string::npos)
      text.replace(at, text.find('\n', at + 1) - at, "\n" + key + " = " + value);
    EXPECT_NE(text, before) << "the demo's rig file has no line " << key;
  };
  set("width_px", "64");
  set("height_px", "48");
  set("fx_px", "348");
  set("clock_rate", "inf");
  set("shape", "\"sphere\"");
  set("leave_out_families",
      R"(["coated", "fabric", "metal", "metallic-paint", "plastic", "powder", "retroreflector",
          "rubber", "stone", "wood"])");
  set("max_lights", "3");
  set("count", "60");
  set("exposures_s", "[80e-6, 1.28e-3, 20.48e-3]");
  return text;
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
  for (const Diagnostic& one : read.diagnostics) ADD_FAILURE() << to_text(one, read.text);
  if (!read.value) return {};
  read.value->session_root = folder / "sessions";
  return std::move(*read.value);
}

}  // namespace lightrig
