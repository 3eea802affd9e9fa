#pragma once

#include <string>

#include "daemon/service/service.h"

namespace lightrig {

/// /v1/status: one line of JSON [docs/control_api.md].
std::string status_json(const Snapshot& snapshot);

/// The progress of a session as the event "progress", with how the devices are as far as is known.
std::string progress_json(const std::string& session, const SessionProgress& progress,
                          const std::optional<RigFacts>& facts);

/// A journal event as the service sends it.
std::string event_json(const std::string& session, const JournalEvent& event);

/// What the preview shows, as the event "preview".
std::string preview_json(const Preview::Facts& facts);

/// /metrics in Prometheus' text format.
std::string metrics_text(const Snapshot& snapshot, std::size_t event_readers);

}  // namespace lightrig
