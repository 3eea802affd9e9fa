#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <system_error>
#include <utility>

#include "core/brdf_table.h"
#include "daemon/session/compare.h"
#include "daemon/session/durable_file.h"
#include "daemon/session/image_numbers.h"
#include "daemon/session/json_parse.h"
#include "daemon/session/manifest.h"
#include "daemon/session/reduction.h"
#include "daemon/session/session_upkeep.h"

namespace lightrig {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

// How far numbers may differ between builds and processors.
constexpr double relative_tolerance = 1e-6;
// Pictures are 8 bits deep: one step is the least that a rounding can move.
constexpr double picture_tolerance = 1.01 / 255;

/// A folder of our own below the system's temporary one, gone at the end.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::error_code problem;
    std::string name = (fs::temp_directory_path(problem) / "lightrig-verify-XXXXXX").string();
    if (!problem && ::mkdtemp(name.data()) != nullptr) path_ = name;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    if (!path_.empty()) fs::remove_all(path_, ignored);
  }
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const fs::path& path() const { return path_; }

 private:
  fs::path path_;
};

bool close(double a, double b, double scale) {
  if (std::isnan(a) || std::isnan(b)) return std::isnan(a) && std::isnan(b);
  if (a == b) return true;  // equal infinities too
  return std::abs(a - b) <= relative_tolerance * std::max({std::abs(a), std::abs(b), scale});
}

// The first place where two JSON documents differ by more than the tolerance; "" when none.
std::string difference(const Json& a, const Json& b, const std::string& path) {
  if (a.is_number() && b.is_number()) {
    // Coefficients near zero are sums of large terms: a difference far below 1 is nothing.
    return close(a.get<double>(), b.get<double>(), 1e-3) ? "" : path;
  }
  if (a.type() != b.type() || a.size() != b.size()) return path;
  if (a.is_object()) {
    for (const auto& [key, value] : a.items()) {
      if (!b.contains(key)) return path + "." + key;
      if (const std::string inner = difference(value, b[key], path + "." + key); !inner.empty()) {
        return inner;
      }
    }
    return "";
  }
  if (a.is_array()) {
    for (std::size_t i = 0; i < a.size(); ++i) {
      const std::string inner = difference(a[i], b[i], fmt::format("{}[{}]", path, i));
      if (!inner.empty()) return inner;
    }
    return "";
  }
  return a == b ? "" : path;
}

// Compares the JSON of two files without what was measured on the clock.
std::string json_difference(const std::string& a, const std::string& b) {
  auto left = parse_json(a), right = parse_json(b);
  if (!left || !right) return "is not JSON";
  for (Json* json : {&*left, &*right}) {
    if (json->is_object()) json->erase("cost");
  }
  const std::string where = difference(*left, *right, "");
  return where.empty() ? "" : "differs at " + where.substr(1);
}

std::string image_difference(const fs::path& a, const fs::path& b, bool picture) {
  const auto left = read_image_numbers(a), right = read_image_numbers(b);
  if (!left) return left.error().message;
  if (!right) return right.error().message;
  if (left->width != right->width || left->height != right->height ||
      left->channels != right->channels) {
    return "has another size or other channels";
  }
  std::size_t different = 0;
  for (std::size_t i = 0; i < left->values.size(); ++i) {
    const auto x = static_cast<double>(left->values[i]), y = static_cast<double>(right->values[i]);
    const bool same = picture ? std::abs(x - y) <= picture_tolerance : close(x, y, 1e-9);
    if (!same) ++different;
  }
  return different == 0 ? ""
                        : fmt::format("differs in {} of {} values", different, left->values.size());
}

std::string brdf_difference(const std::string& a, const std::string& b) {
  MerlFindings findings;
  const auto left = decode_merl(std::as_bytes(std::span(a)), findings);
  const auto right = decode_merl(std::as_bytes(std::span(b)), findings);
  if (!left || !right) return "is not a MERL file";
  if (left->f.size() != right->f.size()) return "has another grid";
  std::size_t different = 0;
  for (std::size_t i = 0; i < left->f.size(); ++i) {
    if (!close(left->f[i], right->f[i], 0)) ++different;
  }
  return different == 0 ? "" : fmt::format("differs in {} of {} values", different, left->f.size());
}

// What is wrong, one line for each file however many checks find fault with it.
class Findings {
 public:
  void add(const std::string& file, const std::string& what) {
    const auto [at, is_new] = line_of_.try_emplace(file, lines_.size());
    if (is_new) {
      lines_.push_back(fmt::format("{}: {}", file, what));
    } else if (lines_[at->second].find(what) == std::string::npos) {
      lines_[at->second] += "; " + what;
    }
  }
  void add(const std::string& what) { lines_.push_back(what); }
  std::size_t size() const { return lines_.size(); }
  std::vector<std::string> lines() && { return std::move(lines_); }

 private:
  std::vector<std::string> lines_;
  std::map<std::string, std::size_t> line_of_;
};

struct Reproduction {
  int equal_bytes = 0, equal_numbers = 0, unequal = 0;
};

void compare_file(const fs::path& stored, const fs::path& again, const std::string& name,
                  Reproduction& out, Findings& findings) {
  const auto was = read_file(stored), is = read_file(again);
  if (!was || !is) {
    ++out.unequal;
    findings.add(name, was ? "the reduction no longer makes it" : was.error().message);
    return;
  }
  if (*was == *is) {
    ++out.equal_bytes;
    return;
  }
  const std::string kind = stored.extension();
  std::string problem;
  if (kind == ".json") {
    problem = json_difference(*was, *is);
  } else if (kind == ".binary") {
    problem = brdf_difference(*was, *is);
  } else if (kind == ".exr" || kind == ".png") {
    problem = image_difference(stored, again, kind == ".png");
  } else {
    problem = "differs";
  }
  if (problem.empty()) {
    ++out.equal_numbers;
  } else {
    ++out.unequal;
    findings.add(name, problem + " when the frames are reduced again");
  }
}

// Files of a folder, by name. report.html is left out: it is result.json in words, and states
// times.
std::set<std::string> files_in(const fs::path& folder) {
  std::set<std::string> names;
  std::error_code problem;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, problem)) {
    const std::string name = entry.path().filename().string();
    if (entry.is_regular_file(problem) && name != "report.html") names.insert(name);
  }
  return names;
}

Reproduction reproduce(const fs::path& session, const fs::path& again, Findings& findings) {
  Reproduction out;
  for (const char* folder : {"radiance", "result"}) {
    std::set<std::string> names = files_in(session / folder);
    if (names.empty()) continue;  // never reduced: nothing to hold it against
    names.merge(files_in(again / folder));
    for (const std::string& name : names) {
      compare_file(session / folder / name, again / folder / name, std::string(folder) + "/" + name,
                   out, findings);
    }
  }
  return out;
}

// Every file that was sealed, against its checksum then; and every file against the list.
int check_manifest(const SessionFolder& folder, Findings& findings) {
  const auto digests = read_manifest(folder);
  if (!digests) {
    findings.add(digests.error().message);
    return 0;
  }
  for (const auto& [name, digest] : *digests) {
    const auto bytes = read_file(folder.root / name);
    if (!bytes) {
      findings.add(name, bytes.error().message);
    } else if (sha256_hex(*bytes) != digest) {
      findings.add(name, "is not what was sealed (checksum differs)");
    }
  }
  const auto files = files_below(folder.root, folder.root);
  if (!files) {
    findings.add(files.error().message);
    return static_cast<int>(digests->size());
  }
  for (const fs::path& file : *files) {
    if (folder.root / file == folder.manifest() || digests->contains(file.generic_string())) {
      continue;
    }
    findings.add(file.generic_string(),
                 "is not in the manifest: it was put there after the session was sealed");
  }
  return static_cast<int>(digests->size());
}

// Every frame the journal names, against the checksum it was journaled with.
int check_frames(const SessionRecord& record, Findings& findings) {
  std::vector<StoredFrame> frames = record.darks;
  for (const CapturedShot& shot : record.shots) {
    frames.insert(frames.end(), shot.frames.begin(), shot.frames.end());
  }
  for (const StoredFrame& frame : frames) {
    const auto bytes = read_file(record.folder.root / frame.file);
    if (!bytes) {
      findings.add(frame.file, bytes.error().message);
    } else if (!frame.sha256.empty() && sha256_hex(*bytes) != frame.sha256) {
      findings.add(frame.file, "is not what was journaled (checksum differs)");
    }
  }
  return static_cast<int>(frames.size());
}

std::string check_reduction(const fs::path& session, int threads, Findings& findings) {
  const TemporaryFolder again;
  if (again.path().empty()) {
    findings.add("reduction: no temporary folder can be made; set TMPDIR");
    return "not reduced again";
  }
  const auto reduced = reduce_session(session, again.path(), threads);
  if (!reduced) {
    findings.add("reduction: " + reduced.error().message);
    return "cannot be reduced";
  }
  const Reproduction found = reproduce(session, again.path(), findings);
  if (found.equal_bytes + found.equal_numbers + found.unequal == 0) {
    return "reducible, not reduced yet";
  }
  if (found.equal_numbers == 0) {
    return fmt::format("reduction reproduced, {} files equal to the byte", found.equal_bytes);
  }
  return fmt::format(
      "reduction reproduced, {} files equal to the byte and {} within {:g} or measured times only",
      found.equal_bytes, found.equal_numbers, relative_tolerance);
}

std::string counted(std::size_t findings) {
  return fmt::format("{} finding{}", findings, findings == 1 ? "" : "s");
}

}  // namespace

Result<VerifyReport> verify_session(const fs::path& session, int threads) {
  std::error_code ignored;
  const SessionFolder folder{session};
  if (!fs::exists(folder.session_json(), ignored)) {
    return fail(
        ErrorCode::not_found,
        fmt::format("verify '{}': not a session folder (no session.json)", session.string()));
  }
  VerifyReport report;
  Findings findings;
  int sealed_files = 0;
  const bool sealed = fs::exists(folder.manifest(), ignored);
  if (sealed) sealed_files = check_manifest(folder, findings);
  const auto record = read_session_folder(session);
  if (!record) {
    findings.add(record.error().message);
    report.summary = fmt::format("'{}' is damaged: {}", session.string(), counted(findings.size()));
    report.findings = std::move(findings).lines();
    return report;
  }
  const int frames = check_frames(*record, findings);
  const std::string reduction =
      frames == 0 ? "nothing captured yet" : check_reduction(session, threads, findings);
  report.findings = std::move(findings).lines();
  report.sound = report.findings.empty();
  report.summary = fmt::format(
      "{}: {}: {}, {} journal events, {} frames, {}; {}", session.filename().string(),
      report.sound ? "sound" : counted(report.findings.size()), record->state,
      record->events.size(), frames,
      sealed ? fmt::format("{} sealed files", sealed_files) : std::string("not sealed yet"),
      reduction);
  return report;
}

}  // namespace lightrig
