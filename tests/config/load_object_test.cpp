#include "config/load_object.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <numbers>

#include "core/mesh_repair.h"
#include "tests/config/scratch_folder.h"
#include "tests/paths.h"

namespace lightrig {
namespace {

using testing::HasSubstr;

// The unit cube's corner tetrahedron: volume 1/6, four faces wound outwards.
constexpr const char* tetrahedron_ply =
    "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float "
    "z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 "
    "0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
constexpr const char* tetrahedron_obj =
    "mtllib absent.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";

std::string facet(const char* a, const char* b, const char* c) {
  return std::string("facet normal 0 0 0\nouter loop\nvertex ") + a + "\nvertex " + b +
         "\nvertex " + c + "\nendloop\nendfacet\n";
}
std::string tetrahedron_stl() {
  const char *o = "0 0 0", *x = "1 0 0", *y = "0 1 0", *z = "0 0 1";
  return "solid t\n" + facet(o, y, x) + facet(o, x, z) + facet(o, z, y) + facet(x, y, z) +
         "endsolid t\n";
}

ObjectConfig mesh_config(const std::filesystem::path& file, double unit = 1) {
  ObjectConfig config;
  config.mesh = file;
  config.unit = unit;
  return config;
}

TEST(LoadObject, ReadsTheSameSolidFromPlyObjAndStl) {
  const ScratchFolder folder;
  for (const auto& file :
       {folder.write("t.ply", tetrahedron_ply), folder.write("t.obj", tetrahedron_obj),
        folder.write("T.STL", tetrahedron_stl())}) {
    SCOPED_TRACE(file.string());
    const auto object = load_object(mesh_config(file));
    ASSERT_TRUE(object) << object.error().message;
    EXPECT_EQ(object->mesh.triangles.cols(), 4);
    EXPECT_EQ(object->repairs.boundary_edges, 0) << "corners of facets are merged";
    EXPECT_NEAR(signed_volume(object->mesh), 1.0 / 6, 1e-12);
    EXPECT_EQ(object->mesh.normals.cols(), object->mesh.vertices.cols());
  }
}

TEST(LoadObject, ScalesTurnsAndMovesAFile) {
  const ScratchFolder folder;
  ObjectConfig config = mesh_config(folder.write("t.ply", tetrahedron_ply), 0.001);
  config.world_from_object = Eigen::Translation3d(0, 0, 0.5) *
                             Eigen::AngleAxisd(std::numbers::pi / 2, Eigen::Vector3d::UnitZ());
  const auto object = load_object(config);
  ASSERT_TRUE(object) << object.error().message;
  const Eigen::Vector3d least = object->mesh.vertices.rowwise().minCoeff();
  const Eigen::Vector3d most = object->mesh.vertices.rowwise().maxCoeff();
  EXPECT_NEAR((least - Eigen::Vector3d(-0.001, 0, 0.5)).norm(), 0, 1e-12);
  EXPECT_NEAR((most - Eigen::Vector3d(0, 0.001, 0.501)).norm(), 0, 1e-12);
  EXPECT_NEAR(signed_volume(object->mesh, least), 1e-9 / 6, 1e-16);
}

TEST(LoadObject, MakesEveryBuiltInShapeOfItsSize) {
  for (const char* shape : {"sphere", "plane", "cylinder", "torus", "teapot"}) {
    ObjectConfig config;
    config.shape = shape;
    config.size = 0.12;
    const auto object = load_object(config);
    ASSERT_TRUE(object) << object.error().message;
    const Eigen::Vector3d extent =
        object->mesh.vertices.rowwise().maxCoeff() - object->mesh.vertices.rowwise().minCoeff();
    EXPECT_NEAR(extent.maxCoeff(), 0.12, 1e-12) << shape;
    EXPECT_THAT(object->description, HasSubstr(shape));
  }
  ObjectConfig config;
  config.shape = "utah";
  EXPECT_FALSE(load_object(config));
}

TEST(LoadObject, SaysWhatItRepaired) {
  const ScratchFolder folder;
  // Inside out, one vertex that is not a number, one triangle without area.
  const auto file = folder.write(
      "bad.obj",
      "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv nan 0 0\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\nf 1 1 "
      "2\nf 1 2 5\n");
  const auto object = load_object(mesh_config(file));
  ASSERT_TRUE(object) << object.error().message;
  EXPECT_EQ(object->mesh.triangles.cols(), 4);
  EXPECT_TRUE(object->repairs.flipped_orientation);
  EXPECT_GT(signed_volume(object->mesh), 0);
  EXPECT_TRUE(object->mesh.vertices.allFinite());
  EXPECT_THAT(object->description, HasSubstr("was inside-out: turned"));
  EXPECT_THAT(object->description, HasSubstr("1 vertex that was no number dropped"));
}

TEST(LoadObject, RefusesAFileOfNothingButNaN) {
  const ScratchFolder folder;
  const auto file =
      folder.write("nan.obj", "v nan nan nan\nv nan nan nan\nv nan nan nan\nf 1 2 3\n");
  const auto object = load_object(mesh_config(file));
  ASSERT_FALSE(object);
  EXPECT_EQ(object.error().code, ErrorCode::invalid_input);
  EXPECT_THAT(object.error().message, HasSubstr("no usable triangle"));
}

TEST(LoadObject, NamesAFaceWhoseVertexIsNotThere) {
  const ScratchFolder folder;
  const std::string ply =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
      "property float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"
      "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
  for (const auto& [face, vertex] :
       {std::pair{"3 0 1 99\n", "vertex 99"}, {"3 0 -1 2\n", "vertex -1"}}) {
    const auto object = load_object(mesh_config(folder.write("stray.ply", ply + face)));
    ASSERT_FALSE(object);
    EXPECT_THAT(object.error().message, HasSubstr("face 2 names " + std::string(vertex)));
    EXPECT_THAT(object.error().message, HasSubstr("there are only 3"));
  }
}

TEST(LoadObject, SaysNothingOfTheNameThatTheLibraryMadeUp) {
  const ScratchFolder folder;
  const auto object = load_object(mesh_config(folder.write("text.stl", "once upon a time")));
  ASSERT_FALSE(object);
  EXPECT_THAT(object.error().message, HasSubstr("text.stl"));
  EXPECT_THAT(object.error().message, testing::Not(HasSubstr("magic")));
}

TEST(LoadObject, NamesAVertexFarOffAndAsksForTheUnitOfAMeshAsLargeAsAHouse) {
  const ScratchFolder folder;
  std::string stray = tetrahedron_obj;
  stray.replace(stray.find("v 0 1 0"), 7, "v 0 1e30 0");
  const auto far = load_object(mesh_config(folder.write("stray.obj", stray)));
  ASSERT_FALSE(far);
  EXPECT_EQ(far.error().code, ErrorCode::invalid_input);
  EXPECT_THAT(far.error().message, HasSubstr("its outermost vertex is (0, 1e+30, 0)"));
  const auto file = folder.write("t.ply", tetrahedron_ply);
  const auto house = load_object(mesh_config(file, 120));
  ASSERT_FALSE(house);
  EXPECT_THAT(house.error().message, HasSubstr("it is 120 m across"));
  EXPECT_THAT(house.error().message, HasSubstr("unit_m"));
  EXPECT_TRUE(load_object(mesh_config(file, 1)));
}

TEST(LoadObject, CountsOneThingAsOneThing) {
  const ScratchFolder folder;
  std::string one = tetrahedron_ply;
  one.replace(one.find("vertex 4"), 8, "vertex 1");
  const auto object = load_object(mesh_config(folder.write("one.ply", one)));
  ASSERT_FALSE(object);
  EXPECT_THAT(object.error().message, testing::Not(HasSubstr("1 vertices")));
  const auto twice = load_object(
      mesh_config(folder.write("twice.obj", std::string(tetrahedron_obj) + "f 1 3 2\n")));
  ASSERT_TRUE(twice) << twice.error().message;
  EXPECT_THAT(twice->description, HasSubstr("1 duplicate triangle dropped"));
}

TEST(LoadObject, RefusesTruncatedAndAbsurdFilesWithTheReason) {
  const ScratchFolder folder;
  const std::string ply = tetrahedron_ply;
  const std::string head = ply.substr(0, ply.find("end_header"));
  std::string absurd = ply;
  absurd.replace(absurd.find("vertex 4"), 8, "vertex 4000000000");
  std::string misspelt = ply;
  misspelt.replace(misspelt.find("property float y"), 8, "proper\xfft");
  std::string with_nul = ply;
  with_nul[with_nul.find("0 0 0\n1") + 1] = '\0';
  std::string two_lines = ply;
  two_lines[two_lines.find("3 0 2 1") + 1] = '\n';
  std::string odd = ply;
  odd.replace(odd.find("float y"), 7, "floatt y");
  std::string nameless = ply;
  nameless.replace(nameless.find("float y"), 7, "float");
  std::string bare = ply;
  bare.insert(bare.find("element face"), "element edge 1\n");
  const std::vector<std::pair<std::filesystem::path, const char*>> files = {
      {folder.write("misspelt.ply", misspelt),
       "line 5 of its header begins with 'proper?t', which no PLY header has"},
      {folder.write("with_nul.ply", with_nul), "end before vertex 1, or its line is not whole"},
      {folder.write("two_lines.ply", two_lines), "end before face 1, or its line is not whole"},
      {folder.write("odd.ply", odd), "line 5 of its header: 'floatt' is no type of a property"},
      {folder.write("nameless.ply", nameless), "line 5 of its header: the property has no name"},
      {folder.write("bare.ply", bare),
       "its header says of no property that its element 'edge' has"},
      {folder.write("cut_faces.ply", ply.substr(0, ply.size() - 16)), "truncated?"},
      {folder.write("cut_vertices.ply", ply.substr(0, ply.find("0 1 0\n"))), ""},
      {folder.write("cut_head.ply", head), "no PLY header"},
      {folder.write("absurd.ply", absurd), "promises 4000000000 vertices and 4 faces, but its"},
      {folder.write("empty.ply", ""), "it is empty"},
      {folder.write("text.stl", "once upon a time"), "export it anew"},
      {folder.write("points.obj", "v 0 0 0\nv 1 0 0\n"), "it "},
      {folder.write("mesh.fbx", "x"), "must end in .ply, .obj or .stl"},
      {folder.path / "absent.ply", "No such file"},
  };
  for (const auto& [file, why] : files) {
    SCOPED_TRACE(file.filename().string());
    const auto object = load_object(mesh_config(file));
    ASSERT_FALSE(object);
    EXPECT_THAT(object.error().message, HasSubstr(file.string()));
    EXPECT_THAT(object.error().message, HasSubstr(why));
  }
  EXPECT_EQ(load_object(mesh_config(folder.path / "absent.ply")).error().code,
            ErrorCode::not_found);
}

// A binary file cut at any byte is refused, or gives what it says it holds.
TEST(LoadObject, NoticesABinaryPlyCutAnywhere) {
  std::string ply =
      "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float "
      "y\nproperty float z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n";
  const float corners[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  ply.append(reinterpret_cast<const char*>(corners), sizeof corners);
  const std::int32_t faces[4][3] = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  for (const auto& face : faces) {
    ply += '\3';
    ply.append(reinterpret_cast<const char*>(face), sizeof face);
  }
  const ScratchFolder folder;
  const auto whole = load_object(mesh_config(folder.write("whole.ply", ply)));
  ASSERT_TRUE(whole) << whole.error().message;
  EXPECT_NEAR(signed_volume(whole->mesh), 1.0 / 6, 1e-6);
  for (std::size_t n = 0; n < ply.size(); ++n)
    EXPECT_FALSE(load_object(mesh_config(folder.write("cut.ply", ply.substr(0, n))))) << n;
}

TEST(LoadObject, ReadsTheScannedMeshesWhereTheyAreAtHand) {
  const char* given = std::getenv("LIGHTRIG_DATA");
  const std::filesystem::path data =
      given != nullptr
          ? given
          : std::filesystem::path(lightrig::test::source_dir) / ".." / "shared" / "data";
  if (!std::filesystem::exists(data / "meshes" / "bunny.ply"))
    GTEST_SKIP() << "no meshes in " << data << "; set LIGHTRIG_DATA";
  const auto bunny = load_object(mesh_config(data / "meshes" / "bunny.ply"));
  ASSERT_TRUE(bunny) << bunny.error().message;
  EXPECT_EQ(bunny->mesh.vertices.cols(), 34834);
  EXPECT_EQ(bunny->repairs.boundary_edges, 223);
  EXPECT_FALSE(bunny->repairs.flipped_orientation);
}

}  // namespace
}  // namespace lightrig
