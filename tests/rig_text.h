#pragma once

#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>

#include "tests/paths.h"

namespace lightrig::test {

/// The text of a shipped rig file, with lines changed: whoever uses it reads it as a person's file
/// would be read. A key or a text that is not there throws: a change that changes nothing would
/// leave a test testing something else.
class RigText {
 public:
  /// `file` of config/, e.g. "demo.toml".
  explicit RigText(const std::string& file) {
    std::ifstream in(std::filesystem::path(lightrig::test::source_dir) / "config" / file);
    std::stringstream bytes;
    bytes << in.rdbuf();
    text_ = bytes.str();
  }

  /// Every line `key = …` gets this value.
  void set(const std::string& key, const std::string& value) {
    bool found = false;
    for (std::size_t at = text_.find("\n" + key + " = "); at != std::string::npos;
         at = text_.find("\n" + key + " = ", at + 1)) {
      put(at, key, value);
      found = true;
    }
    if (!found) throw std::runtime_error("the rig file has no line " + key);
  }
  /// The last line `key = …`: keep-out volumes have shapes too, the object comes after them.
  void set_last(const std::string& key, const std::string& value) {
    const std::size_t at = text_.rfind("\n" + key + " = ");
    if (at == std::string::npos) throw std::runtime_error("the rig file has no line " + key);
    put(at, key, value);
  }
  /// Every occurrence.
  void replace(const std::string& from, const std::string& to) {
    std::size_t at = text_.find(from);
    if (at == std::string::npos) throw std::runtime_error("the rig file has no " + from);
    for (; at != std::string::npos; at = text_.find(from, at + to.size()))
      text_.replace(at, from.size(), to);
  }

  /// A few pixels, candidates, lights and materials: a whole session takes a second of processor
  /// time.
  void make_small() {
    set("width_px", "64");
    set("height_px", "48");
    set("fx_px", "348");
    set("leave_out_families",
        R"(["coated", "fabric", "metal", "metallic-paint", "plastic", "powder", "retroreflector",
          "rubber", "stone", "wood"])");
    set("max_lights", "3");
    set("count", "60");
    set("exposures_s", "[80e-6, 1.28e-3, 20.48e-3]");
  }

  const std::string& text() const { return text_; }

 private:
  void put(std::size_t at, const std::string& key, const std::string& value) {
    const std::size_t end = text_.find('\n', at + 1);
    text_.replace(at, end - at, "\n" + key + " = " + value);
  }

  std::string text_;
};

}  // namespace lightrig::test
