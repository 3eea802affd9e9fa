#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "config/rig.h"
#include "daemon/session/session_folder.h"
#include "sim/world.h"

namespace lightrig::campaign {

/// What the laboratory recorded of every picture, by its content, against what a session stored.
class Judge {
 public:
  Judge(const Rig& rig, const sim::World& world);

  /// Frames that the journal vouches for and that are not what it says: no picture that was taken,
  /// another exposure, another lamp, another place, in motion.
  std::vector<std::string> wrong_frames(const std::filesystem::path& session) const;

 private:
  void check(const std::filesystem::path& root, const StoredFrame& stored, const Shot* planned,
             std::vector<std::string>& wrong) const;

  const Rig& rig_;
  std::map<std::uint64_t, sim::ExposureRecord> by_content_;
};

}  // namespace lightrig::campaign
