#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "daemon/session/prepare.h"

namespace lightrig {

/// One line of "what this scene did not need": so many left out of so many; the rest was done.
struct LeftOutLine {
  std::string name;  ///< key in result.json
  std::string what;  ///< for a person
  std::int64_t left_out = 0;
  std::optional<std::int64_t> of;  ///< left out and done together; empty where nothing counts it
  std::string why;
};

/// What a plan did not need, in the order people read it: the same lines before a session and in
/// its result.
std::vector<LeftOutLine> planned_left_out(const Prepared& prepared);

/// True of a remark that says only that a material was held out because the session asks for it.
bool held_out_as_asked(const std::string& remark);

}  // namespace lightrig
