#pragma once

#include <span>
#include <string>

#include "core/brdf_table.h"
#include "core/mesh.h"

namespace lightrig {

/// SHA-256, in hexadecimal, of the names and numbers that statistics are made of, whatever files
/// they came from.
std::string materials_hash(std::span<const Material> materials);

/// SHA-256, in hexadecimal, of vertices, normals and triangles as they were loaded and placed.
std::string mesh_hash(const Mesh& mesh);

}  // namespace lightrig
