#pragma once

#include <string>
#include <vector>

#include "cli/json_fields.h"
#include "cli/service_client.h"

namespace lightrig::cli {

/// How a session of the service's list stands, and what goes on with it.
std::string standing(const Json& one, const std::string& root);

/// The newest session where it waits for somebody to go on with it, as a line of the status, or "":
/// after a crash nothing else says that one was under way.
std::string unfinished_words(const ServiceClient& client);

/// "L02 open; lightrig resume ID"; "" where no shot was taken back.
std::string open_words(const std::vector<std::string>& taken_back, const std::string& id);
/// The same of a session that the service says is done; "" too where it cannot be told.
std::string open_words(const ServiceClient& client, const Json& session);
/// The same of a folder whose result is from before; "" where it has none.
std::string open_words(const std::string& folder);

}  // namespace lightrig::cli
