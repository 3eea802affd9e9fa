// Any bytes as a mesh file. The first byte chooses its kind: the loader goes by the extension.
#include <array>
#include <cstdio>

#include "config/load_object.h"
#include "config/mesh_file.h"
#include "tests/fuzz/scratch_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace lightrig;
  if (size == 0) return 0;
  constexpr std::array<const char*, 3> kinds{".ply", ".obj", ".stl"};
  const std::string& raw = fuzz::scratch_file("mesh", data + 1, size - 1);
  const std::string path = raw + kinds[data[0] % kinds.size()];
  if (std::rename(raw.c_str(), path.c_str()) != 0) std::abort();
  ObjectConfig object;
  object.mesh = path;
  (void)load_object(object);
  std::remove(path.c_str());
  return 0;
}
