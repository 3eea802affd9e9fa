#include "study/store.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <span>
#include <sstream>

#include "daemon/session/durable_file.h"

namespace lightrig {
namespace {

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::size_t begin = 0;
  while (begin < text.size()) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    lines.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return lines;
}

std::vector<std::string> words(const std::string& text) {
  std::vector<std::string> out;
  std::istringstream in(text);
  for (std::string word; in >> word;) out.push_back(word);
  return out;
}

std::vector<int> integers(const std::string& text) {
  std::vector<int> out;
  const char* at = text.data();
  const char* end = at + text.size();
  while (at < end) {
    int value = 0;
    const auto parsed = std::from_chars(at, end, value);
    if (parsed.ec != std::errc()) break;
    out.push_back(value);
    at = parsed.ptr + 1;
  }
  return out;
}

}  // namespace

std::filesystem::path job_file(const std::filesystem::path& out, int split,
                               const std::string& object) {
  return out / "jobs" / fmt::format("{:03}-{}.csv", split, object);
}

std::filesystem::path cost_file(const std::filesystem::path& out, int split,
                                const std::string& object) {
  return out / "jobs" / fmt::format("{:03}-{}.cost.csv", split, object);
}

std::filesystem::path split_file(const std::filesystem::path& out, int split) {
  return out / "jobs" / fmt::format("{:03}.split.csv", split);
}

std::filesystem::path spheres_file(const std::filesystem::path& out, const std::string& object) {
  return out / "jobs" / fmt::format("000-{}.spheres.png", object);
}

Result<void> claim_folder(const std::filesystem::path& out, const StudyIdentity& identity) {
  if (Result<void> made = make_folder(out / "jobs"); !made) return made;
  const Result<std::string> there = read_file(out / "study.txt");
  if (!there) return write_durably(out / "study.txt", identity.text);
  if (*there == identity.text) return {};
  return fail(ErrorCode::invalid_input,
              fmt::format("{} holds a study with other options, meshes or materials (compare its "
                          "study.txt); choose another folder or give the same ones",
                          out.string()));
}

Result<StudyIdentity> read_identity(const std::filesystem::path& out) {
  Result<std::string> text = read_file(out / "study.txt");
  if (!text) {
    return tl::unexpected(with_context(out.string() + " is not a study's folder", text.error()));
  }
  StudyIdentity identity;
  identity.text = *text;
  for (const std::string& line : lines_of(*text)) {
    const std::size_t equals = line.find('=');
    if (equals == std::string::npos) continue;
    const std::string key = line.substr(0, equals), value = line.substr(equals + 1);
    if (key == "splits") identity.splits = integers(value).empty() ? 0 : integers(value)[0];
    if (key == "table1") identity.table1 = value == "1";
    if (key == "materials") identity.materials = value;
    if (key == "rig") identity.rig = value;
    if (key == "methods") identity.methods = words(value);
    if (key == "seconds_per_light") {
      std::from_chars(value.data(), value.data() + value.size(), identity.seconds_per_light);
    }
    if (key.starts_with("object ")) {
      identity.objects.push_back(key.substr(7));
      identity.lights.push_back(integers(value));
    }
  }
  return identity;
}

Result<void> store_job(const std::filesystem::path& out, int split, const std::string& object,
                       const JobResult& result) {
  std::string costs = cost_header(), rows = study_header();
  for (const CostRow& row : result.costs) costs += to_csv(row);
  for (const StudyRow& row : result.rows) rows += to_csv(row);
  if (!result.spheres.empty()) {
    const std::string png(reinterpret_cast<const char*>(result.spheres.data()),
                          result.spheres.size());
    if (Result<void> w = write_durably(spheres_file(out, object), png); !w) return w;
  }
  // The rows last: their file is what says that the job is done.
  if (Result<void> w = write_durably(cost_file(out, split, object), costs); !w) return w;
  return write_durably(job_file(out, split, object), rows);
}

std::string split_header() {
  return "split,basis,trained_on,components,model_sigma,unsaid_sigma,range_slack\n";
}

Result<void> store_split(const std::filesystem::path& out, const StudySplit& split) {
  std::string lines = split_header();
  const auto add = [&](const std::string& name, const BrdfBasis& basis) {
    // Without folds of its own a basis knows no σ; the pseudo-inverse asks for none.
    const std::string sigmas =
        basis.left_out ? fmt::format("{:.6g},{:.6g}", basis.model_sigma, basis.unsaid_sigma) : ",";
    lines += fmt::format("{},{},{},{},{},{:.6g}\n", split.index, name, basis.materials,
                         basis.components(), sigmas, basis.range_slack);
  };
  add("pseudo-inverse", split.paper);
  add("map", split.whole);
  for (const auto& [name, basis] : split.priors) add("map-" + name, basis);
  return write_durably(split_file(out, split.index), lines);
}

Result<StoredStudy> read_study(const std::filesystem::path& out) {
  Result<StudyIdentity> identity = read_identity(out);
  if (!identity) return tl::unexpected(identity.error());
  StoredStudy study{*identity, {}, {}, {}, 0, {}};
  for (const std::string& object : identity->objects) {
    const Result<std::string> png = read_file(spheres_file(out, object));
    if (!png) continue;
    const auto bytes = std::as_bytes(std::span(*png));
    study.spheres.emplace_back(object, std::vector<std::byte>(bytes.begin(), bytes.end()));
  }
  for (int split = 0; split < identity->splits; ++split) {
    if (const Result<std::string> lines = read_file(split_file(out, split))) {
      study.splits += lines->substr(std::min(lines->size(), split_header().size()));
    }
    for (const std::string& object : identity->objects) {
      const std::filesystem::path path = job_file(out, split, object);
      const Result<std::string> text = read_file(path);
      if (!text) continue;
      const std::vector<std::string> lines = lines_of(*text);
      for (std::size_t i = 1; i < lines.size(); ++i) {
        std::optional<StudyRow> row = study_row_from_csv(lines[i]);
        if (!row) {
          return fail(ErrorCode::invalid_input,
                      fmt::format("{}:{}: not a row of a study; delete the file and run the study "
                                  "again, only this job is repeated",
                                  path.string(), i + 1));
        }
        study.rows.push_back(std::move(*row));
      }
      ++study.jobs_there;
      const Result<std::string> costs = read_file(cost_file(out, split, object));
      if (!costs) continue;
      for (const std::string& line : lines_of(*costs)) {
        if (std::optional<CostRow> row = cost_row_from_csv(line)) study.costs.push_back(*row);
      }
    }
  }
  return study;
}

}  // namespace lightrig
