#include "daemon/session/input_hash.h"

#include <cstddef>

#include "daemon/session/durable_file.h"

namespace lightrig {
namespace {

template <class Numbers>
std::string hash_of(const Numbers& numbers) {
  return sha256_hex(
      std::as_bytes(std::span(numbers.data(), static_cast<std::size_t>(numbers.size()))));
}

}  // namespace

std::string materials_hash(std::span<const Material> materials) {
  std::string digests;
  for (const Material& material : materials) {
    digests += material.name + " " + hash_of(material.table.f);
    // Statistics over φd that were taken up already no longer lie here.
    if (material.azimuth.size() > 0) digests += " " + hash_of(material.azimuth);
    digests += "\n";
  }
  return sha256_hex(digests);
}

std::string mesh_hash(const Mesh& mesh) {
  return sha256_hex(hash_of(mesh.vertices) + hash_of(mesh.normals) + hash_of(mesh.triangles));
}

}  // namespace lightrig
