#include "planner_scene.h"
#include "tests/paths.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/QR>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <numbers>
#include <random>
#include <sstream>

namespace lightrig::test {

std::optional<std::string> data_folder() {
  const char* named = std::getenv("LIGHTRIG_DATA");
  const std::string folder =
      named != nullptr ? named : std::string(lightrig::test::source_dir) + "/../shared/data";
  if (!std::filesystem::is_directory(folder)) return std::nullopt;
  return folder;
}

Mesh data_mesh(const std::string& folder, const std::string& name) {
  std::ifstream in(folder + "/meshes/" + name + ".ply");
  std::string word;
  Eigen::Index vertices = 0, faces = 0;
  for (std::string line; std::getline(in, line) && line != "end_header";) {
    std::istringstream words(line);
    words >> word;
    if (word != "element") continue;
    Eigen::Index count = 0;
    words >> word >> count;
    (word == "vertex" ? vertices : faces) = count;
  }
  Mesh mesh;
  mesh.vertices.resize(3, vertices);
  mesh.normals.resize(3, vertices);
  mesh.triangles.resize(3, faces);
  for (Eigen::Index i = 0; i < vertices; ++i) {
    for (int k = 0; k < 3; ++k) in >> mesh.vertices(k, i);
    for (int k = 0; k < 3; ++k) in >> mesh.normals(k, i);
  }
  int corners = 0;
  for (Eigen::Index i = 0; i < faces; ++i) {
    in >> corners;
    for (int k = 0; k < 3; ++k) in >> mesh.triangles(k, i);
  }
  mesh.normals.colwise().normalize();
  const Eigen::Vector3d centre =
      0.5 * (mesh.vertices.rowwise().minCoeff() + mesh.vertices.rowwise().maxCoeff());
  mesh.vertices.colwise() -= centre;
  mesh.vertices /= mesh.vertices.colwise().norm().maxCoeff();
  return mesh;
}

Mesh sphere_mesh(int levels) {
  std::vector<Eigen::Vector3d> vertex = {{1, 0, 0},  {-1, 0, 0}, {0, 1, 0},
                                         {0, -1, 0}, {0, 0, 1},  {0, 0, -1}};
  std::vector<std::array<int, 3>> face = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4},
                                          {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  for (int level = 0; level < levels; ++level) {
    std::map<std::pair<int, int>, int> middle;
    const auto between = [&](int a, int b) {
      const auto [at, fresh] =
          middle.try_emplace(std::minmax(a, b), static_cast<int>(vertex.size()));
      if (fresh) {
        const Eigen::Vector3d sum =
            vertex[static_cast<std::size_t>(a)] + vertex[static_cast<std::size_t>(b)];
        vertex.push_back(sum.normalized());
      }
      return at->second;
    };
    std::vector<std::array<int, 3>> finer;
    for (const auto& [a, b, c] : face) {
      const int ab = between(a, b), bc = between(b, c), ca = between(c, a);
      finer.insert(finer.end(), {{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}});
    }
    face = finer;
  }
  Mesh mesh;
  mesh.vertices.resize(3, static_cast<Eigen::Index>(vertex.size()));
  for (std::size_t i = 0; i < vertex.size(); ++i) {
    mesh.vertices.col(static_cast<Eigen::Index>(i)) = vertex[i];
  }
  mesh.normals = mesh.vertices;
  mesh.triangles.resize(3, static_cast<Eigen::Index>(face.size()));
  for (std::size_t i = 0; i < face.size(); ++i) {
    mesh.triangles.col(static_cast<Eigen::Index>(i)) =
        Eigen::Vector3i(face[i][0], face[i][1], face[i][2]);
  }
  return mesh;
}

namespace {

/// ln max(f, 1e-4) of one file, (8100 × 3); NaN where the file holds a negative value.
Eigen::ArrayXXd ln_of_file(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::array<std::int32_t, 3> n{};
  in.read(reinterpret_cast<char*>(n.data()), sizeof n);
  const Eigen::Index cells = Eigen::Index{n[0]} * n[1] * n[2];
  Eigen::ArrayXXd f(cells, 3);
  in.read(reinterpret_cast<char*>(f.data()), static_cast<std::streamsize>(f.size() * 8));
  const std::array<double, 3> scale = {1.0 / 1500, 1.15 / 1500, 1.66 / 1500};
  for (int c = 0; c < 3; ++c) {
    for (Eigen::Index i = 0; i < cells; ++i) {
      f(i, c) = f(i, c) < 0
                    ? std::nan("")
                    : std::log(std::max(f(i, c) * scale[static_cast<std::size_t>(c)], 1e-4));
    }
  }
  return f;
}

void principal_components(BrdfBasis& basis, Eigen::MatrixXd H, Eigen::Index k) {
  basis.mean = H.rowwise().mean();
  H.colwise() -= basis.mean;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(H.transpose() * H);
  const Eigen::Index columns = H.cols();
  k = std::min(k, columns - 1);
  basis.stddev = eigen.eigenvalues().reverse().head(k).cwiseMax(0).cwiseSqrt() /
                 std::sqrt(static_cast<double>(columns - 1));
  const Eigen::MatrixXd V = H * eigen.eigenvectors().rowwise().reverse().leftCols(k);
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(V);
  basis.V = qr.householderQ() * Eigen::MatrixXd::Identity(H.rows(), k);
}

}  // namespace

BrdfBasis data_basis(const std::string& folder, ChannelLayout layout, Eigen::Index k) {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder + "/materials/npf")) {
    if (entry.path().extension() == ".binary") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  std::vector<Eigen::ArrayXXd> ln;
  for (const auto& file : files) ln.push_back(ln_of_file(file));
  BrdfBasis basis;
  basis.layout = layout;
  basis.materials = static_cast<int>(files.size());
  const Eigen::Index cells = ln[0].rows();
  basis.valid.assign(static_cast<std::size_t>(cells), 1);
  for (const auto& one : ln) {
    for (Eigen::Index i = 0; i < cells; ++i) {
      if (one.row(i).isNaN().any()) basis.valid[static_cast<std::size_t>(i)] = 0;
    }
  }
  const bool stacked = layout == ChannelLayout::stacked;
  const auto count = static_cast<Eigen::Index>(ln.size());
  Eigen::MatrixXd H(stacked ? 3 * cells : cells, stacked ? count : 3 * count);
  for (Eigen::Index m = 0; m < count; ++m) {
    for (int c = 0; c < 3; ++c) {
      Eigen::ArrayXd column = ln[static_cast<std::size_t>(m)].col(c);
      for (Eigen::Index i = 0; i < cells; ++i) {
        if (basis.valid[static_cast<std::size_t>(i)] == 0) column[i] = 0;
      }
      if (stacked) {
        H.col(m).segment(c * cells, cells) = column;
      } else {
        H.col(3 * m + c) = column;
      }
    }
  }
  principal_components(basis, H, k);
  return basis;
}

BrdfBasis random_basis(std::uint64_t seed, BivariateGrid grid, ChannelLayout layout, int channels,
                       Eigen::Index k, double fall) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  BrdfBasis basis;
  basis.grid = grid;
  basis.layout = layout;
  basis.channels = channels;
  basis.valid.assign(static_cast<std::size_t>(grid.cells()), 1);
  const Eigen::Index rows = (layout == ChannelLayout::stacked ? channels : 1) * grid.cells();
  Eigen::MatrixXd smooth(rows, k);
  for (Eigen::Index j = 0; j < k; ++j) {
    const double a = normal(random), b = normal(random), c = normal(random), d = normal(random);
    for (Eigen::Index r = 0; r < rows; ++r) {
      const auto cell = static_cast<int>(r % grid.cells());
      const double x = (grid.row_h(cell) + 0.5) / grid.n_h;
      const double y = (grid.column_d(cell) + 0.5) / grid.n_d;
      smooth(r, j) = std::cos(3 * a * x + 3 * b * y + c) + 0.3 * d * x * y +
                     0.1 * normal(random) * std::pow(fall, static_cast<double>(j));
    }
  }
  const Eigen::HouseholderQR<Eigen::MatrixXd> qr(smooth);
  basis.V = qr.householderQ() * Eigen::MatrixXd::Identity(rows, k);
  basis.mean = Eigen::VectorXd::Constant(rows, -3.0);
  basis.stddev.resize(k);
  for (Eigen::Index j = 0; j < k; ++j)
    basis.stddev[j] = 10 * std::pow(fall, static_cast<double>(j));
  return basis;
}

CandidateBins random_bins(std::uint64_t seed, BivariateGrid grid, int candidates, bool one_column) {
  std::mt19937_64 random(seed);
  const auto below = [&](int n) {
    return static_cast<int>(random() % static_cast<std::uint64_t>(n));
  };
  CandidateBins bins;
  bins.grid = grid;
  bins.offset.push_back(0);
  std::vector<std::int32_t> last;
  for (int i = 0; i < candidates; ++i) {
    std::vector<std::int32_t> cells;
    const int kind = below(12);
    if (kind == 0) {
      // sees nothing
    } else if (kind == 1) {
      cells = last;  // the same cells as another candidate
    } else {
      for (int run = one_column ? 1 : 1 + below(3); run > 0; --run) {
        const int column = below(grid.n_d), from = below(grid.n_h);
        const int to = from + below(grid.n_h - from + 1);
        for (int h = from; h < to; ++h) cells.push_back(grid.cell(h, column));
      }
      std::sort(cells.begin(), cells.end());
      cells.erase(std::unique(cells.begin(), cells.end()), cells.end());
    }
    last = cells;
    bins.cell.insert(bins.cell.end(), cells.begin(), cells.end());
    bins.offset.push_back(static_cast<std::int64_t>(bins.cell.size()));
  }
  return bins;
}

std::vector<LightPosition> spread_lights(int count, bool distant, double radius) {
  std::vector<LightPosition> lights;
  const double golden = std::numbers::pi * (3 - std::sqrt(5.0));
  for (int i = 0; i < count; ++i) {
    const double z = 1 - 2 * (i + 0.5) / count, r = std::sqrt(1 - z * z);
    const Eigen::Vector3d d =
        Eigen::Vector3d(r * std::cos(golden * i), r * std::sin(golden * i), z).normalized();
    lights.push_back({distant, distant ? d : Eigen::Vector3d(radius * d)});
  }
  return lights;
}

CameraModel facing_camera(bool distant, double distance, int width, int height) {
  CameraModel camera;
  camera.projection =
      distant ? CameraModel::Projection::orthographic : CameraModel::Projection::perspective;
  camera.width = width;
  camera.height = height;
  const double scale = 0.45 * std::min(width, height);
  camera.fx = camera.fy = distant ? scale : scale * std::sqrt(distance * distance - 1);
  camera.cx = 0.5 * (width - 1);
  camera.cy = 0.5 * (height - 1);
  camera.camera_from_world = look_at(Eigen::Vector3d(0.1, -distance, 0.2), Eigen::Vector3d::Zero(),
                                     Eigen::Vector3d::UnitZ());
  return camera;
}

void lose_third_light(const Selection& whole, std::size_t candidates, SelectionOptions& options) {
  options.excluded.assign(candidates, 0);
  for (std::size_t i = 0; i < whole.lights.size(); ++i) {
    const int candidate = whole.lights[i].candidate;
    if (i == 2) {
      options.excluded[static_cast<std::size_t>(candidate)] = 1;
    } else {
      options.already.push_back(candidate);
    }
  }
  options.max_lights = 1;
}

}  // namespace lightrig::test
