#include "cli/standing.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <filesystem>
#include <system_error>

#include "daemon/session/taken_back.h"

namespace lightrig::cli {
namespace {

namespace fs = std::filesystem;

std::vector<std::string> taken_back_of(const Json& one) {
  std::vector<std::string> names;
  for (const Json& name : part(one, "taken_back"))
    if (name.is_string()) names.push_back(name.get<std::string>());
  return names;
}

}  // namespace

std::string standing(const Json& one, const std::string& root) {
  const std::string state = text(one, "state"), id = text(one, "id");
  const bool result = one.value("result", false);
  if (state == "damaged") return fmt::format("damaged; lightrig verify {}/{}", root, id);
  if (state.empty()) return result ? "result" : "no result";
  const std::string so_far = fmt::format("{} after {} of {} lights", state,
                                         whole(one, "shots_done"), whole(one, "shots_planned"));
  if (state == "capturing" || state == "reducing") return so_far;
  // What was there before a light was taken back is no result of the session as it is.
  if (const std::string open = open_words(taken_back_of(one), id); result && !open.empty())
    return open;
  if (state == "done")
    return fmt::format("{}; lightrig resume {}",
                       result ? "result, not sealed" : "captured, no result", id);
  return fmt::format("{}; lightrig resume {}", so_far, id);
}

std::string unfinished_words(const ServiceClient& client) {
  const auto reply = client.get_json("/v1/sessions");
  if (!reply || part(*reply, "sessions").empty()) return {};
  const Json& newest = part(*reply, "sessions").front();
  const std::string state = text(newest, "state");
  if (state != "interrupted" && state != "paused") return {};
  return fmt::format("unfinished {}: {}\n", text(newest, "id"),
                     standing(newest, text(*reply, "root")));
}

std::string open_words(const std::vector<std::string>& taken_back, const std::string& id) {
  if (taken_back.empty()) return {};
  return fmt::format("{} open; lightrig resume {}", fmt::join(taken_back, ", "), id);
}

std::string open_words(const ServiceClient& client, const Json& session) {
  if (text(session, "state") != "done") return {};
  const auto reply = client.get_json("/v1/sessions");
  if (!reply) return {};
  for (const Json& one : part(*reply, "sessions"))
    if (text(one, "id") == text(session, "id"))
      return open_words(taken_back_of(one), text(one, "id"));
  return {};
}

std::string open_words(const std::string& folder) {
  std::error_code error;
  const SessionFolder session{folder};
  if (!fs::exists(session.result() / "result.json", error)) return {};
  const fs::path real = fs::canonical(folder, error);
  return open_words(taken_back(session), error ? folder : real.filename().string());
}

}  // namespace lightrig::cli
