#include "config/load_materials.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "core/builtin_materials.h"
#include "tests/config/scratch_folder.h"

namespace lightrig {
namespace {

using testing::HasSubstr;

MerlTable uniform(int n_h, int n_d, double value) {
  MerlTable table;
  table.n_h = n_h;
  table.n_d = n_d;
  table.n_phi = 1;
  table.f.assign(static_cast<std::size_t>(3 * n_h * n_d), value);
  return table;
}
std::vector<std::byte> file_of(int n_h, int n_d, double value) {
  return encode_merl(uniform(n_h, n_d, value));
}

MaterialsConfig config_of(const ScratchFolder& folder) {
  MaterialsConfig config;
  config.source = folder.path.string();
  return config;
}

TEST(LoadMaterials, ReadsAFolderInTheOrderOfNames) {
  const ScratchFolder folder;
  folder.write("zinc.binary", file_of(8, 6, 0.25));
  folder.write("amber.binary", file_of(8, 6, 0.5));
  folder.write("README.txt", "not a material");
  const auto loaded = load_materials(config_of(folder));
  ASSERT_TRUE(loaded) << loaded.error().message;
  ASSERT_EQ(loaded->materials.size(), 2U);
  EXPECT_EQ(loaded->materials[0].name, "amber");
  EXPECT_EQ(loaded->materials[1].source, "zinc.binary");
  EXPECT_EQ(loaded->materials[0].table.grid, (BivariateGrid{8, 6}));
  EXPECT_NEAR(loaded->materials[0].table.f(10, 1), 0.5, 1e-12);
  EXPECT_TRUE(loaded->remarks.empty());
}

TEST(LoadMaterials, LeavesBrokenFilesOutAndSaysWhyOfEach) {
  const ScratchFolder folder;
  folder.write("a.binary", file_of(8, 6, 0.25));
  folder.write("b.binary", file_of(8, 6, 0.25));
  auto bytes = file_of(8, 6, 0.25);
  bytes.resize(bytes.size() - 5);
  folder.write("truncated.binary", bytes);
  folder.write("empty.binary", "");
  std::vector<std::byte> absurd(12);
  const std::int32_t sizes[3] = {2000000000, 2000000000, 180};
  std::memcpy(absurd.data(), sizes, sizeof sizes);
  folder.write("absurd.binary", absurd);
  folder.write("nothing.binary", file_of(8, 6, std::nan("")));
  std::filesystem::create_directory(folder.path / "folder.binary");

  const auto loaded = load_materials(config_of(folder));
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_EQ(loaded->materials.size(), 2U);
  ASSERT_EQ(loaded->remarks.size(), 5U);
  EXPECT_THAT(loaded->remarks[0], HasSubstr("absurd: left out: "));
  EXPECT_THAT(loaded->remarks[1], HasSubstr("empty: left out: "));
  EXPECT_THAT(loaded->remarks[2], HasSubstr("folder: left out: it is a directory"));
  EXPECT_THAT(loaded->remarks[3], HasSubstr("nothing: left out: it holds no valid value"));
  EXPECT_THAT(loaded->remarks[4], HasSubstr("truncated: left out: "));
}

TEST(LoadMaterials, CountsValuesThatAreNotMeasurements) {
  const ScratchFolder folder;
  auto bytes = file_of(8, 6, 0.25);
  folder.write("a.binary", bytes);
  const double bad[3] = {-1.0, std::nan(""), HUGE_VAL};
  std::memcpy(bytes.data() + 12, bad, sizeof bad);
  folder.write("b.binary", bytes);
  const auto loaded = load_materials(config_of(folder));
  ASSERT_TRUE(loaded) << loaded.error().message;
  ASSERT_EQ(loaded->remarks.size(), 1U);
  EXPECT_THAT(
      loaded->remarks[0],
      HasSubstr("b: of 144 values 2 are not numbers, 0 above 1e+06 1/sr and 1 negative: ignored"));
  EXPECT_TRUE(std::isnan(loaded->materials[1].table.f(0, 0)));
  EXPECT_FALSE(std::isnan(loaded->materials[1].table.f(5, 0)));
}

TEST(LoadMaterials, RefusesAnEmptyFolderAMissingOneAndAFile) {
  const ScratchFolder folder;
  auto loaded = load_materials(config_of(folder));
  ASSERT_FALSE(loaded);
  EXPECT_EQ(loaded.error().code, ErrorCode::invalid_input);
  EXPECT_THAT(loaded.error().message, HasSubstr("holds 0 .binary files, 0 usable"));
  EXPECT_THAT(loaded.error().message, HasSubstr("put MERL .binary files there"));

  MaterialsConfig config;
  config.source = (folder.path / "nowhere").string();
  loaded = load_materials(config);
  ASSERT_FALSE(loaded);
  EXPECT_EQ(loaded.error().code, ErrorCode::not_found);

  config.source = folder.write("file", "x").string();
  loaded = load_materials(config);
  ASSERT_FALSE(loaded);
  EXPECT_EQ(loaded.error().code, ErrorCode::invalid_input);
}

TEST(LoadMaterials, RefusesGridsThatDifferAndNamesBoth) {
  const ScratchFolder folder;
  folder.write("a.binary", file_of(8, 6, 0.25));
  folder.write("b.binary", file_of(6, 8, 0.25));
  const auto loaded = load_materials(config_of(folder));
  ASSERT_FALSE(loaded);
  EXPECT_THAT(loaded.error().message, HasSubstr("'a' has 8 × 6 cells, 'b' has 6 × 8"));
}

TEST(LoadMaterials, HoldsOutByNameAndRefusesANameThatIsNotThere) {
  const ScratchFolder folder;
  for (const char* name : {"a.binary", "b.binary", "c.binary"})
    folder.write(name, file_of(8, 6, 0.25));
  MaterialsConfig config = config_of(folder);
  config.leave_out = {"b"};
  const auto loaded = load_materials(config);
  ASSERT_TRUE(loaded) << loaded.error().message;
  ASSERT_EQ(loaded->materials.size(), 2U);
  EXPECT_EQ(loaded->materials[1].name, "c");
  config.leave_out = {"d"};
  EXPECT_FALSE(load_materials(config)) << "a misspelt name would leave the truth in the basis";
}

TEST(LoadMaterials, HoldsAFamilyOfTheBuiltInSetOut) {
  MaterialsConfig config;
  config.leave_out_families = {"plastic"};
  config.leave_out = {"gold-polished"};
  const auto loaded = load_materials(config);
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_GE(loaded->materials.size(), 40U);
  const auto plastics =
      std::ranges::count(builtin_materials(), "plastic", &BuiltinMaterial::family);
  EXPECT_EQ(std::ssize(loaded->materials) + plastics + 1, std::ssize(builtin_materials()));
  for (const Material& m : loaded->materials) {
    EXPECT_NE(m.family, "plastic");
    EXPECT_NE(m.name, "gold-polished");
  }
}

}  // namespace
}  // namespace lightrig
