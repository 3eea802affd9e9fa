#include "config/mesh_file.h"

#include <assimp/postprocess.h>
#include <assimp/scene.h>
#include <fmt/format.h>

#include <algorithm>
#include <assimp/Importer.hpp>
#include <cctype>
#include <exception>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "config/ply_check.h"
#include "config/read_bytes.h"

// Debian builds the library with its assertions, which end the process: a broken file would end the
// service. This takes the place of the library's own handler, and import_bytes() catches what it
// throws.
namespace Assimp {
[[noreturn]] void aiAssertViolation(const char* expression, const char* /*file*/, int /*line*/) {
  throw std::runtime_error(fmt::format("it breaks what the reader relies on ({})", expression));
}
}  // namespace Assimp

namespace lightrig {
namespace {

std::string lower_extension(const std::filesystem::path& file) {
  std::string extension = file.extension().string();
  if (!extension.empty()) extension.erase(0, 1);
  std::ranges::transform(extension, extension.begin(),
                         [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

std::string upper(std::string text) {
  std::ranges::transform(text, text.begin(),
                         [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return text;
}

void append(const aiMesh& part, bool with_normals, Mesh& mesh) {
  const Eigen::Index first = mesh.vertices.cols(), n = part.mNumVertices;
  mesh.vertices.conservativeResize(3, first + n);
  for (unsigned i = 0; i < part.mNumVertices; ++i) {
    const aiVector3D& v = part.mVertices[i];
    mesh.vertices.col(first + i) = Eigen::Vector3f(v.x, v.y, v.z).cast<double>();
  }
  if (with_normals) {
    mesh.normals.conservativeResize(3, first + n);
    for (unsigned i = 0; i < part.mNumVertices; ++i) {
      const aiVector3D& v = part.mNormals[i];
      mesh.normals.col(first + i) = Eigen::Vector3f(v.x, v.y, v.z).cast<double>();
    }
  }
  Eigen::Index t = mesh.triangles.cols();
  mesh.triangles.conservativeResize(3, t + part.mNumFaces);
  for (unsigned i = 0; i < part.mNumFaces; ++i) {
    const aiFace& face = part.mFaces[i];
    if (face.mNumIndices != 3) continue;
    for (unsigned k = 0; k < 3; ++k)
      mesh.triangles(k, t) = static_cast<int>(first) + static_cast<int>(face.mIndices[k]);
    ++t;
  }
  mesh.triangles.conservativeResize(3, t);
}

struct Imported {
  Mesh mesh;
  std::string problem;  ///< "" when there is none
};

// Bytes in memory have no name: the library makes one up, and says it in its messages, which begin
// with the format as often as not and end with a full stop or none.
std::string in_a_sentence(std::string message, const std::string& extension) {
  const std::string made_up = "$$$___magic___$$$." + extension;
  for (auto at = message.find(made_up); at != std::string::npos; at = message.find(made_up))
    message.replace(at, made_up.size(), "it");
  const std::string format = upper(extension) + ": ";
  if (message.starts_with(format)) message.erase(0, format.size());
  while (message.ends_with('.')) message.pop_back();
  return message;
}

bool names_its_own_vertices(const aiMesh* mesh) {
  return std::ranges::all_of(std::span(mesh->mFaces, mesh->mNumFaces), [&](const aiFace& face) {
    return std::ranges::all_of(std::span(face.mIndices, face.mNumIndices),
                               [&](unsigned index) { return index < mesh->mNumVertices; });
  });
}

Imported import_bytes(std::span<const std::byte> bytes, const std::string& extension) {
  // The library throws on some broken files and returns null on others; both end here.
  try {
    Assimp::Importer importer;
    importer.SetPropertyInteger(AI_CONFIG_PP_SBP_REMOVE,
                                aiPrimitiveType_POINT | aiPrimitiveType_LINE);
    const aiScene* scene =
        importer.ReadFileFromMemory(bytes.data(), bytes.size(), 0, extension.c_str());
    if (scene == nullptr) return {{}, in_a_sentence(importer.GetErrorString(), extension)};
    // Its further steps believe every index.
    if (!std::ranges::all_of(std::span(scene->mMeshes, scene->mNumMeshes), names_its_own_vertices))
      return {{}, "a face of it names a vertex that there is not"};
    scene = importer.ApplyPostProcessing(aiProcess_Triangulate | aiProcess_SortByPType);
    if (scene == nullptr) return {{}, in_a_sentence(importer.GetErrorString(), extension)};
    const std::span parts(scene->mMeshes, scene->mNumMeshes);
    // STL has one normal per facet, which would make every facet an island.
    const bool with_normals = extension != "stl" && std::ranges::all_of(parts, [](const aiMesh* m) {
                                return m->HasNormals();
                              });
    Imported imported;
    for (const aiMesh* part : parts)
      if (part->HasPositions() && part->HasFaces()) append(*part, with_normals, imported.mesh);
    return imported;
  } catch (const std::exception& error) {
    return {{}, in_a_sentence(error.what(), extension)};
  }
}

}  // namespace

Result<Mesh> read_mesh_file(const std::filesystem::path& file) {
  const auto failed = [&](ErrorCode code, const std::string& why) {
    return fail(code, fmt::format("read the mesh '{}': {}", file.string(), why));
  };
  const std::string extension = lower_extension(file);
  if (extension != "ply" && extension != "obj" && extension != "stl")
    return failed(ErrorCode::invalid_input, "its name must end in .ply, .obj or .stl");
  const auto bytes = read_bytes(file);
  if (!bytes) return failed(bytes.error().code, bytes.error().message);
  if (bytes->empty()) return failed(ErrorCode::invalid_input, "it is empty");
  if (extension == "ply")
    if (const auto problem = ply_shortfall(*bytes))
      return failed(ErrorCode::invalid_input, *problem);

  Imported imported = import_bytes(*bytes, extension);
  if (!imported.problem.empty())
    return failed(ErrorCode::invalid_input,
                  fmt::format("it cannot be read as {}: {}. Copy it again from where it came from, "
                              "or open it in a mesh editor and export it anew as PLY",
                              upper(extension), imported.problem));
  if (imported.mesh.triangles.cols() == 0)
    return failed(ErrorCode::invalid_input,
                  "it holds no triangles, only points or lines; export the surface");
  return std::move(imported.mesh);
}

}  // namespace lightrig
