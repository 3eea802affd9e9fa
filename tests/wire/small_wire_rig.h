#pragma once

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/paths.h"

namespace lightrig::test {

/// A shipped wire rig made small and quick: a sphere on a few pixels, few candidates and lights,
/// axes that cross the dome in half a second, a rigid arm. Texts only: whoever uses it reads it as
/// a person's file would be read.
class SmallWireRig {
 public:
  /// `file` of config/, e.g. "wire_modbus_tcp.toml".
  explicit SmallWireRig(const std::string& file) {
    std::ifstream in(std::filesystem::path(lightrig::test::source_dir) / "config" / file);
    std::stringstream bytes;
    bytes << in.rdbuf();
    text_ = bytes.str();
    // What the kernel allows is plenty for a picture of a few pixels.
    long ceiling = 0;
    std::ifstream("/proc/sys/net/core/rmem_max") >> ceiling;
    set("socket_buffer_bytes", std::to_string(std::min(ceiling, 4194304L)));
    set("width_px", "64");
    set("height_px", "48");
    set("fx_px", "348");
    set("readout_ms", "5");
    set("max_speed_deg_per_s", "340");
    set("max_acceleration_deg_per_s2", "1700");
    set("settle_s", "0.05");
    set("warm_up_s", "0.05");
    set("arm_frequency_hz", "0");
    set("size_m", "0.12");
    replace("shape = \"teapot\"", "shape = \"sphere\"");
    set("leave_out_families",
        R"(["coated", "fabric", "metal", "metallic-paint", "plastic", "powder", "retroreflector",
          "rubber", "stone", "wood"])");
    set("max_lights", "3");
    set("count", "60");
    set("exposures_s", "[80e-6, 1.28e-3, 20.48e-3]");
    if (text_.find("controllers/") != std::string::npos)
      replace("controllers/",
              (std::filesystem::path(lightrig::test::source_dir) / "config/controllers/").string());
  }

  /// Every line `key = …` gets this value.
  void set(const std::string& key, const std::string& value) {
    bool found = false;
    for (std::size_t at = text_.find("\n" + key + " = "); at != std::string::npos;
         at = text_.find("\n" + key + " = ", at + 1)) {
      const std::size_t end = text_.find('\n', at + 1);
      text_.replace(at, end - at, "\n" + key + " = " + value);
      found = true;
    }
    if (!found) throw std::runtime_error("the rig file has no line " + key);
  }
  /// Every occurrence.
  void replace(const std::string& from, const std::string& to) {
    std::size_t at = text_.find(from);
    if (at == std::string::npos) throw std::runtime_error("the rig file has no " + from);
    for (; at != std::string::npos; at = text_.find(from, at + to.size()))
      text_.replace(at, from.size(), to);
  }
  void sessions_in(const std::filesystem::path& folder) {
    set("session_root", "\"" + folder.string() + "\"");
  }

  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

}  // namespace lightrig::test
