#pragma once

#include <functional>
#include <stop_token>

namespace lightrig {

/// How somebody waits for a computation: until told to stop, and hearing of what gets done
/// meanwhile. Both may be empty.
struct Patience {
  std::stop_token stop = {};
  /// Something is done: a stage, a file, a shot, a picture. From whichever thread did it, perhaps
  /// several at a time; returns at once. A watchdog may feed on it.
  std::function<void()> beat = {};

  void tell() const {
    if (beat) beat();
  }
};

}  // namespace lightrig
