#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace lightrig::cli {

/// One line on how a session stands, at most `width` columns: bar, percent, time left, predicted
/// error, what is happening. `progress` is the event "progress" or the session of /v1/status.
std::string progress_line(const nlohmann::ordered_json& progress, int width);

/// What a person at the rig should read at once of an event of the journal, though nothing waits
/// for it: that the object does not lie where it should. "" of any other.
std::string standing_warning(const nlohmann::ordered_json& event);

/// Shows progress: one line rewritten in place on a terminal, else a plain line whenever a shot is
/// done or the activity's kind changes.
class ProgressView {
 public:
  ProgressView(bool terminal, int width) : terminal_(terminal), width_(width) {}
  void show(const nlohmann::ordered_json& progress);
  /// A line of its own, above the bar.
  void note(const std::string& line);
  void end();

 private:
  bool terminal_;
  int width_;
  bool drawn_ = false;
  std::string last_;
};

}  // namespace lightrig::cli
