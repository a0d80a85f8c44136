#include "anigen/mesh_health/weld.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>
#include <unordered_map>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::mesh_health {

namespace {

constexpr std::uint64_t kHashFactor = 0x9E3779B97F4A7C15u;

std::uint64_t mixed(std::uint64_t hash, std::uint64_t value) {
  hash = (hash ^ value) * kHashFactor;
  return hash ^ (hash >> 29);
}

struct CellHash {
  std::size_t operator()(const std::array<std::int64_t, 3>& cell) const {
    std::uint64_t hash = 0;
    for (const std::int64_t c : cell) hash = mixed(hash, static_cast<std::uint64_t>(c));
    return static_cast<std::size_t>(hash);
  }
};

struct FaceHash {
  std::size_t operator()(const Triangle& face) const {
    std::uint64_t hash = 0;
    for (const std::int32_t v : face) hash = mixed(hash, static_cast<std::uint64_t>(v));
    return static_cast<std::size_t>(hash);
  }
};

void require_weldable(const Mesh& mesh, double distance) {
  if (mesh.faces.empty()) throw InputError("", "mesh.faces", "there are no faces");
  if (!std::isfinite(distance) || distance < 0)
    throw InputError("", "distance", "must be a finite number of at least 0");
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    if (!mesh.vertices[v].allFinite())
      throw InputError("", "mesh.vertices[" + std::to_string(v) + "]", "the vertex is not finite");
  }
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    for (const std::int32_t v : mesh.faces[f]) {
      if (v < 0 || at(v) >= mesh.vertices.size())
        throw InputError("", "mesh.faces[" + std::to_string(f) + "]", "there is no vertex " + std::to_string(v));
    }
  }
}

/// Joins points no farther from each other than the distance: each looks into the 27 cells around its own.
void join_near(const std::vector<Eigen::Vector3f>& points, double distance, DisjointSets& sets) {
  std::unordered_map<std::array<std::int64_t, 3>, std::vector<std::size_t>, CellHash> cells;
  const auto cell_of = [&](const Eigen::Vector3f& p) {
    std::array<std::int64_t, 3> cell{};
    // Beyond 2^53 cells a coordinate's rounding is larger than the distance anyway.
    constexpr double kMost = 9e15;
    for (Eigen::Index k = 0; k < 3; ++k)
      cell[at(k)] = static_cast<std::int64_t>(std::clamp(std::floor(double{p[k]} / distance), -kMost, kMost));
    return cell;
  };
  for (std::size_t i = 0; i < points.size(); ++i) {
    const auto cell = cell_of(points[i]);
    for (std::int64_t n = 0; n < 27; ++n) {
      const auto found = cells.find({cell[0] + n % 3 - 1, cell[1] + n / 3 % 3 - 1, cell[2] + n / 9 - 1});
      if (found == cells.end()) continue;
      for (const std::size_t other : found->second) {
        const bool near = (points[i] - points[other]).cast<double>().norm() <= distance;
        if (near) sets.join_lowest(i, other);
      }
    }
    cells[cell].push_back(i);
  }
}

}  // namespace

std::size_t PositionHash::operator()(const Eigen::Vector3f& position) const {
  std::uint64_t hash = 0;
  for (Eigen::Index k = 0; k < 3; ++k) {
    const float x = position[k] + 0.0f;  // -0 becomes 0
    std::uint32_t bits = 0;
    std::memcpy(&bits, &x, sizeof bits);
    hash = mixed(hash, bits);
  }
  return static_cast<std::size_t>(hash);
}

bool is_degenerate(const std::vector<Eigen::Vector3f>& vertices, const Triangle& face) {
  // Differences of floats are exact in double unless their sizes are very far apart, and so is most of their product.
  constexpr double kRounding = 1e-15;
  double longest = 0.0;
  for (std::size_t k = 0; k < 3; ++k) {
    const Eigen::Vector3d side = vertices[at(face[(k + 1) % 3])].cast<double>() - vertices[at(face[k])].cast<double>();
    longest = std::max(longest, side.squaredNorm());
  }
  return area_vector(vertices, face).norm() <= kRounding * longest;
}

WeldedMesh weld(const Mesh& mesh, double distance) {
  require_weldable(mesh, distance);
  WeldedMesh result;
  std::unordered_map<Eigen::Vector3f, std::int32_t, PositionHash> known;
  known.reserve(mesh.vertices.size());
  for (const Eigen::Vector3f& vertex : mesh.vertices) {
    const auto [place, is_new] = known.try_emplace(vertex, static_cast<std::int32_t>(result.places.size()));
    if (is_new) result.places.push_back(vertex);
    result.of_vertex.push_back(place->second);
  }
  if (distance > 0) {
    DisjointSets sets(result.places.size());
    join_near(result.places, distance, sets);
    std::vector<std::int32_t> renumbered(result.places.size(), -1);
    std::vector<Eigen::Vector3f> kept;
    for (std::size_t p = 0; p < result.places.size(); ++p) {
      if (sets.find(p) != p) continue;
      renumbered[p] = static_cast<std::int32_t>(kept.size());
      kept.push_back(result.places[p]);
    }
    for (std::int32_t& place : result.of_vertex) place = renumbered[sets.find(at(place))];
    result.places = std::move(kept);
  }
  std::unordered_map<Triangle, std::size_t, FaceHash> seen;
  seen.reserve(mesh.faces.size());
  std::vector<char> used(mesh.vertices.size(), 0);
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    Triangle face{};
    for (std::size_t k = 0; k < 3; ++k) {
      used[at(mesh.faces[f][k])] = 1;
      face[k] = result.of_vertex[at(mesh.faces[f][k])];
    }
    Triangle sorted = face;
    std::sort(sorted.begin(), sorted.end());
    if (sorted[0] == sorted[1] || sorted[1] == sorted[2]) {
      ++result.collapsed_faces;
    } else if (!seen.try_emplace(sorted, f).second) {
      ++result.duplicate_faces;
    } else {
      result.faces.push_back(face);
      result.face_of_file.push_back(f);
    }
  }
  result.isolated_vertices = static_cast<std::size_t>(std::count(used.begin(), used.end(), 0));
  return result;
}

void move_apart(Mesh& mesh) {
  constexpr double kShare = 1e-6;
  const double distance = kShare * bounding_box(mesh.vertices).diagonal();
  std::unordered_map<Eigen::Vector3f, int, PositionHash> count;
  std::vector<int> earlier(mesh.vertices.size(), 0);
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) earlier[v] = count[mesh.vertices[v]]++;
  if (std::all_of(earlier.begin(), earlier.end(), [](int n) { return n == 0; })) return;
  std::vector<Eigen::Vector3d> middle(mesh.vertices.size(), Eigen::Vector3d::Zero());
  for (const Triangle& face : mesh.faces) {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const std::int32_t v : face) sum += mesh.vertices[at(v)].cast<double>();
    for (const std::int32_t v : face) middle[at(v)] += sum / 3.0 - mesh.vertices[at(v)].cast<double>();
  }
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    if (earlier[v] == 0 || middle[v].norm() == 0.0) continue;
    const Eigen::Vector3d moved = mesh.vertices[v].cast<double>() + earlier[v] * distance * middle[v].normalized();
    mesh.vertices[v] = moved.cast<float>();
  }
}

}  // namespace anigen::mesh_health
