#include "core/builtin_materials.h"

#include <algorithm>
#include <utility>

#include "core/azimuth_model.h"
#include "core/builtin_families.h"

namespace lightrig {
namespace {

// The models and the list that points into them.
struct BuiltinSet {
  std::vector<LayeredReflectance> models;
  std::vector<BuiltinMaterial> materials;
};

BuiltinSet make_builtin_set() {
  using Family = std::pair<const char*, std::vector<MaterialSpec> (*)()>;
  const Family families[] = {
      {"metal", builtin_metals},     {"metallic-paint", builtin_metallic_paints},
      {"coated", builtin_coated},    {"plastic", builtin_plastics},
      {"rubber", builtin_rubbers},   {"paint", builtin_paints},
      {"wood", builtin_woods},       {"fabric", builtin_fabrics},
      {"ceramic", builtin_ceramics}, {"stone", builtin_stones},
      {"powder", builtin_powders},   {"retroreflector", builtin_retroreflectors},
  };
  std::vector<std::pair<MaterialSpec, const char*>> specs;
  for (const auto& [family, list] : families)
    for (MaterialSpec& spec : list()) specs.emplace_back(std::move(spec), family);
  std::sort(specs.begin(), specs.end(),
            [](const auto& a, const auto& b) { return a.first.name < b.first.name; });

  BuiltinSet set;
  set.models.reserve(specs.size());
  for (const auto& [spec, family] : specs) set.models.emplace_back(spec.layers, spec.body);
  for (std::size_t i = 0; i < specs.size(); ++i) {
    const LayeredReflectance* model = &set.models[i];
    set.materials.push_back({specs[i].first.name, specs[i].second, specs[i].first.source,
                             [model](const HalfDiff& angles) { return (*model)(angles); }, model});
  }
  return set;
}

}  // namespace

std::span<const BuiltinMaterial> builtin_materials() {
  static const BuiltinSet set = make_builtin_set();
  return set.materials;
}

const BuiltinMaterial* find_builtin(const std::string& name) {
  const std::span<const BuiltinMaterial> all = builtin_materials();
  const auto found = std::lower_bound(
      all.begin(), all.end(), name,
      [](const BuiltinMaterial& material, const std::string& n) { return material.name < n; });
  return found != all.end() && found->name == name ? &*found : nullptr;
}

std::vector<Material> builtin_tables(std::span<const BuiltinMaterial* const> materials,
                                     const BivariateGrid& grid, int n_phi, bool with_azimuths) {
  const ConfigurationGrid configurations = configuration_grid(grid, n_phi);
  std::vector<Material> tables;
  tables.reserve(materials.size());
  for (const BuiltinMaterial* material : materials) {
    const Eigen::ArrayXXd each = material->model->tabulate_each(configurations);
    tables.push_back({material->name, material->family, material->source,
                      cell_means(each, configurations),
                      with_azimuths ? azimuth_departures(each, grid.cells()) : Eigen::ArrayXXf()});
  }
  return tables;
}

std::vector<Material> builtin_tables(const BivariateGrid& grid, int n_phi) {
  std::vector<const BuiltinMaterial*> all;
  for (const BuiltinMaterial& material : builtin_materials()) all.push_back(&material);
  return builtin_tables(all, grid, n_phi);
}

}  // namespace lightrig
