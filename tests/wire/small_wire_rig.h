#pragma once

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>

#include "tests/paths.h"
#include "tests/rig_text.h"

namespace lightrig::test {

/// A shipped wire rig made small and quick: a sphere on a few pixels, few candidates and lights,
/// axes that cross the dome in half a second, a rigid arm.
class SmallWireRig : public RigText {
 public:
  /// `file` of config/, e.g. "wire_modbus_tcp.toml".
  explicit SmallWireRig(const std::string& file) : RigText(file) {
    make_small();
    // What the kernel allows is plenty for a picture of a few pixels.
    long ceiling = 0;
    std::ifstream("/proc/sys/net/core/rmem_max") >> ceiling;
    set("socket_buffer_bytes", std::to_string(std::min(ceiling, 4194304L)));
    set("readout_ms", "5");
    set("max_speed_deg_per_s", "340");
    set("max_acceleration_deg_per_s2", "1700");
    set("settle_s", "0.05");
    set("warm_up_s", "0.05");
    set("arm_frequency_hz", "0");
    set("size_m", "0.12");
    replace("shape = \"teapot\"", "shape = \"sphere\"");
    if (text().find("controllers/") != std::string::npos)
      replace("controllers/",
              (std::filesystem::path(lightrig::test::source_dir) / "config/controllers/").string());
  }

  void sessions_in(const std::filesystem::path& folder) {
    set("session_root", "\"" + folder.string() + "\"");
  }
};

}  // namespace lightrig::test
