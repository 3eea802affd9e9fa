// materials: the statistics' raw material, built in or brought along.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>

#include "cli/json_fields.h"
#include "cli/say.h"
#include "cli/verbs.h"
#include "config/json_text.h"
#include "config/load_materials.h"
#include "core/builtin_materials.h"
#include "daemon/session/durable_file.h"

namespace lightrig::cli {
namespace {

constexpr int averaged_phi = 36;

struct Range {
  double least = 0, median = 0, most = 0;  ///< [1/sr] over cells and channels
  std::size_t values = 0;
};

Range range_of(const BrdfTable& table) {
  std::vector<double> values;
  for (Eigen::Index i = 0; i < table.f.size(); ++i)
    if (std::isfinite(table.f(i))) values.push_back(table.f(i));
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  return {values.front(), values[values.size() / 2], values.back(), values.size()};
}

int unknown_material(const std::string& name) {
  return complain(
      fmt::format("no built-in material is called \"{}\"; lightrig materials list shows "
                  "all; a file must exist and end in .binary",
                  name));
}

int tell(const std::string& name, const std::string& family, const std::string& source,
         const BrdfTable& table_, bool json) {
  const Range range = range_of(table_);
  if (json) {
    say(json_text(Json{{"name", name},
                       {"family", family},
                       {"source", source},
                       {"grid", {table_.grid.n_h, table_.grid.n_d}},
                       {"values", range.values},
                       {"least_per_sr", range.least},
                       {"median_per_sr", range.median},
                       {"most_per_sr", range.most}}));
    return 0;
  }
  say(
      fmt::format("name    {}\nfamily  {}\nsource  {}\ngrid    {} × {} (θh × θd)\nf       {} … {} "
                  "1/sr, median {}\n",
                  name, family.empty() ? "–" : family, source, table_.grid.n_h, table_.grid.n_d,
                  figure(range.least), figure(range.most), figure(range.median)));
  return 0;
}

}  // namespace

int materials_list(bool json) {
  Json list = Json::array();
  std::vector<std::vector<std::string>> rows;
  std::map<std::string, int> families;
  for (const BuiltinMaterial& one : builtin_materials()) {
    list.push_back({{"name", one.name}, {"family", one.family}, {"source", one.source}});
    rows.push_back({one.name, one.family});
    ++families[one.family];
  }
  if (json) {
    say(json_text(list));
    return 0;
  }
  std::string summary;
  for (const auto& [family, count] : families)
    summary += fmt::format("{}{} {}", summary.empty() ? "" : ", ", count, family);
  say(table({"material", "family"}, rows) + fmt::format("{} materials: {}", rows.size(), summary));
  return 0;
}

int materials_info(const std::string& name, bool json) {
  if (const BuiltinMaterial* found = find_builtin(name))
    return tell(found->name, found->family, found->source,
                tabulate(found->reflectance, BivariateGrid{}, averaged_phi), json);
  const auto file = read_file(name);
  if (!file && file.error().code == ErrorCode::not_found) return unknown_material(name);
  if (!file) return complain(file.error());
  MerlFindings findings;
  const auto merl = decode_merl(std::as_bytes(std::span(*file)), findings);
  if (!merl) return complain(with_context(name, merl.error()));
  if (findings.negative + findings.not_a_number > 0 && !json)
    say(fmt::format("{} values below zero and {} that are no number count as invalid",
                    findings.negative, findings.not_a_number));
  return tell(std::filesystem::path(name).stem().string(), "", name, to_bivariate(*merl), json);
}

int materials_import(const std::string& directory, const std::string& output) {
  MaterialsConfig config;
  config.source = directory;
  const auto loaded = load_materials(config);
  if (!loaded) return complain(with_context("import " + directory, loaded.error()));
  for (const std::string& remark : loaded->remarks) complain(remark);
  std::error_code error;
  std::filesystem::create_directories(output, error);
  if (error) return complain(fmt::format("cannot make {}: {}", output, error.message()));
  // The bivariate table is all that statistics need: 0.2 MB a material instead of 33.
  for (const Material& one : loaded->materials) {
    const auto path = std::filesystem::path(output) / (one.name + ".binary");
    if (auto written = write_durably(path, encode_merl(to_merl(one.table, 1))); !written)
      return complain(with_context("import", written.error()));
  }
  say(fmt::format(
      "{} materials written to {}; name it in the rig file: [materials] source = \"{}\"",
      loaded->materials.size(), output, output));
  return 0;
}

}  // namespace lightrig::cli
