#pragma once

#include <string>

#include "config/session_spec.h"
#include "core/mesh.h"
#include "core/result.h"

namespace lightrig {

struct LoadedObject {
  Mesh mesh;  ///< in the world frame [m]
  MeshRepairs repairs;
  std::string description;  ///< one line: source, vertices, triangles, what was repaired
};

/// The mesh of an object, built in or from a file (Assimp), scaled, posed and repaired. Errors:
/// not_found, invalid_input (nothing usable left, NaN only, zero extent), with the reason.
Result<LoadedObject> load_object(const ObjectConfig& config);

}  // namespace lightrig
