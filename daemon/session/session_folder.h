#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "config/rig.h"
#include "core/image.h"
#include "core/plan.h"
#include "core/result.h"
#include "daemon/session/journal.h"

namespace lightrig {

/// One stored frame.
struct StoredFrame {
  std::string file;  ///< relative to the session folder, e.g. "frames/L03/e1.exr"
  /// "dark" (lamp off, common to all shots), "ambient" (lamp off, this shot's), "metering" and
  /// "bracket" (lamp on: both are data of the shot; the metering frame is not taken a second time
  /// when its exposure is among the chosen ones).
  std::string role;
  double exposure = 0;  ///< [s] as applied
  std::string sha256;   ///< of the file, as journaled
};

/// A shot as the journal states it: everything reduction needs besides the frames' bytes.
struct CapturedShot {
  std::string name;  ///< "L01" … in order of selection, "H01" … held out
  int index = -1;    ///< into Plan::shots
  bool held_out = false;
  std::vector<StoredFrame> frames;        ///< ambient, metering and bracket
  std::vector<double> exposures_skipped;  ///< [s]
  double elapsed_s = 0;  ///< measured: session seconds from start to this shot stored
  double lamp_power = 1;
};

/// Whether a name that was read from a session folder's files stays inside that folder.
bool stays_inside(const std::filesystem::path& name);

/// Names and paths of a session folder; knows its layout [docs/session_folder.md], holds no state.
struct SessionFolder {
  std::filesystem::path root;
  std::filesystem::path rig_toml() const { return root / "rig.toml"; }
  std::filesystem::path session_toml() const { return root / "session.toml"; }
  std::filesystem::path session_json() const { return root / "session.json"; }
  std::filesystem::path plan_json() const { return root / "plan.json"; }
  std::filesystem::path journal() const { return root / "journal.jsonl"; }
  std::filesystem::path frames() const { return root / "frames"; }
  std::filesystem::path radiance() const { return root / "radiance"; }
  std::filesystem::path result() const { return root / "result"; }
  std::filesystem::path rejected() const { return root / "rejected"; }
  std::filesystem::path inputs() const {
    return root / "inputs";
  }  ///< mesh, reference: copies of what was named
  std::filesystem::path manifest() const { return root / "manifest-sha256.txt"; }
};

/// What a session folder holds, read back from it alone.
struct SessionRecord {
  SessionFolder folder;
  std::string id;  ///< as begun; the folder may have been renamed or copied since
  Rig rig;
  SessionSpec spec;
  Plan plan;                       ///< plan.json with what the journal's `replanned` events changed
  std::vector<StoredFrame> darks;  ///< lamp-off frames common to all shots
  std::vector<CapturedShot> shots;  ///< in order of capture
  std::string state;                ///< "capturing", "paused", "done", "aborted", "faulted"
  bool sealed = false;              ///< by its last event; the manifest is written after that
  std::vector<JournalEvent> events;
};
/// Errors: not_found when there is no session there; invalid_input when a part of it is damaged or
/// missing, naming the part.
Result<SessionRecord> read_session_folder(const std::filesystem::path& root);

/// What a journal says has been captured.
struct Captured {
  std::vector<StoredFrame> darks;
  std::vector<CapturedShot> shots;  ///< in order of capture, retaken ones by their last capture
  std::string state = "capturing";  ///< as in SessionRecord
  double elapsed_s = 0;             ///< measured: session seconds up to the last journaled fact
  std::string outcome_reason;       ///< of the last pause or end; "" while capturing
  bool sealed = false;
  std::map<std::string, std::uint64_t> retakes;  ///< how often a shot was taken back, by name
};
/// Errors: invalid_input when an event lacks what it must say, with its sequence number.
Result<Captured> captured_of(const std::vector<JournalEvent>& events);

/// "L01" … in order of selection, "H01" … for held-out shots.
std::string shot_name(const Plan& plan, int index);

}  // namespace lightrig
