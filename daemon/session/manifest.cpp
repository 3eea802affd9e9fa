#include "daemon/session/manifest.h"

#include <fmt/format.h>

#include <algorithm>
#include <sstream>
#include <system_error>

#include "daemon/session/durable_file.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t digest_letters = 64;

bool is_result(const std::string& name) {
  return name.starts_with("radiance/") || name.starts_with("result/");
}

}  // namespace

Result<std::map<std::string, std::string>> read_manifest(const SessionFolder& folder) {
  const auto text = read_file(folder.manifest());
  if (!text) return tl::unexpected(text.error());
  std::map<std::string, std::string> digests;
  std::istringstream lines(*text);
  int number = 0;
  for (std::string line; std::getline(lines, line);) {
    ++number;
    if (line.empty()) continue;
    const std::size_t space = line.find_first_of(" \t");
    const std::size_t name_at =
        space == digest_letters ? line.find_first_not_of(" \t*", space) : std::string::npos;
    const fs::path name = name_at == std::string::npos ? "" : line.substr(name_at);
    if (!stays_inside(name)) {
      return fail(
          ErrorCode::invalid_input,
          fmt::format("manifest-sha256.txt:{}: is not '<sha256>  <path in the folder>'", number));
    }
    digests[name.generic_string()] = line.substr(0, space);
  }
  return digests;
}

Result<void> renew_results_in_manifest(const SessionFolder& folder, const Patience& patience) {
  std::error_code ignored;
  if (!fs::exists(folder.manifest(), ignored)) return {};
  auto digests = read_manifest(folder);
  if (!digests) return tl::unexpected(digests.error());
  std::erase_if(*digests, [](const auto& entry) { return is_result(entry.first); });
  for (const fs::path& results : {folder.radiance(), folder.result()}) {
    for (const fs::directory_entry& entry : fs::directory_iterator(results, ignored)) {
      if (!entry.is_regular_file(ignored) || entry.path().extension() == ".part") continue;
      const auto bytes = read_file(entry.path());
      if (!bytes) return tl::unexpected(bytes.error());
      (*digests)[entry.path().lexically_relative(folder.root).generic_string()] =
          sha256_hex(*bytes);
      patience.tell();
    }
  }
  std::string text;
  for (const auto& [name, digest] : *digests) text += digest + "  " + name + "\n";
  return write_durably(folder.manifest(), text);
}

}  // namespace lightrig
