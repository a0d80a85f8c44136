#include "anigen/rig/curve/solid_mesh.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <unordered_map>

#include "anigen/geometry/simplify.h"

namespace anigen::rig {
namespace {

/// Corners of the six tetrahedra of a cell, by bits x, y, z: from 0 to 7 along three edges in each order.
constexpr std::array<std::array<int, 4>, 6> kTetrahedra{
    {{0, 1, 3, 7}, {0, 1, 5, 7}, {0, 2, 3, 7}, {0, 2, 6, 7}, {0, 4, 5, 7}, {0, 4, 6, 7}}};

class TetrahedraMarch {
 public:
  explicit TetrahedraMarch(const SolidField& field) : field_(field) {
    const auto& size = field.grid.size;
    for (int z = 0; z + 1 < size[2]; ++z) {
      for (int y = 0; y + 1 < size[1]; ++y) {
        for (int x = 0; x + 1 < size[0]; ++x) add_cell(x, y, z);
      }
    }
  }

  std::vector<Eigen::Vector3d> vertices;
  std::vector<Triangle> faces;

 private:
  /// Never next to zero: vertices of the surface keep apart from the corners, and so from each other.
  double value(std::size_t node) const {
    const double least = 0.05 * field_.grid.spacing, v = static_cast<double>(field_.distance[node]);
    return v < 0.0 ? std::min(v, -least) : std::max(v, least);
  }

  void add_cell(int x, int y, int z) {
    std::array<std::size_t, 8> nodes{};
    int inside = 0;
    for (int corner = 0; corner < 8; ++corner) {
      nodes[at(corner)] = field_.grid.index(x + (corner & 1), y + (corner >> 1 & 1), z + (corner >> 2));
      inside += field_.distance[nodes[at(corner)]] < 0.0F ? 1 : 0;
    }
    if (inside == 0 || inside == 8) return;
    for (const auto& tetrahedron : kTetrahedra) {
      std::vector<std::size_t> in, out;
      for (const int corner : tetrahedron) {
        const std::size_t node = nodes[at(corner)];
        (field_.distance[node] < 0.0F ? in : out).push_back(node);
      }
      if (in.empty() || out.empty()) continue;
      if (in.size() == 2) {
        const std::array<int, 4> ring{cut(in[0], out[0]), cut(in[0], out[1]), cut(in[1], out[1]), cut(in[1], out[0])};
        add_face(ring[0], ring[1], ring[2], in, out);
        add_face(ring[0], ring[2], ring[3], in, out);
      } else if (in.size() == 1) {
        add_face(cut(in[0], out[0]), cut(in[0], out[1]), cut(in[0], out[2]), in, out);
      } else {
        add_face(cut(in[0], out[0]), cut(in[1], out[0]), cut(in[2], out[0]), in, out);
      }
    }
  }

  Eigen::Vector3d place(std::size_t node) const {
    const auto c = field_.grid.cell(node);
    return field_.grid.center(c[0], c[1], c[2]);
  }

  /// The vertex on the edge between two nodes, one for all tetrahedra around it.
  int cut(std::size_t a, std::size_t b) {
    if (a > b) std::swap(a, b);
    const auto [found, made] = known_.emplace(a * field_.grid.count() + b, static_cast<int>(vertices.size()));
    if (made) {
      const double t = value(a) / (value(a) - value(b));
      vertices.emplace_back((1.0 - t) * place(a) + t * place(b));
    }
    return found->second;
  }

  void add_face(int a, int b, int c, const std::vector<std::size_t>& in, const std::vector<std::size_t>& out) {
    Eigen::Vector3d outward = Eigen::Vector3d::Zero();
    for (const std::size_t node : out) outward += place(node) / static_cast<double>(out.size());
    for (const std::size_t node : in) outward -= place(node) / static_cast<double>(in.size());
    const Eigen::Vector3d normal = (vertices[at(b)] - vertices[at(a)]).cross(vertices[at(c)] - vertices[at(a)]);
    if (normal.dot(outward) < 0.0) std::swap(b, c);
    faces.push_back({a, b, c});
  }

  const SolidField& field_;
  std::unordered_map<std::size_t, int> known_;
};

double volume_of(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& faces) {
  double sum = 0.0;
  for (const Triangle& t : faces) {
    sum += vertices[at(t[0])].dot(vertices[at(t[1])].cross(vertices[at(t[2])])) / 6.0;
  }
  return sum;
}

}  // namespace

std::vector<ClosedMesh> solid_pieces(const SolidField& field) {
  const TetrahedraMarch march(field);
  std::vector<int> root(march.vertices.size());
  std::iota(root.begin(), root.end(), 0);
  const auto find = [&](int v) {
    while (root[at(v)] != v) v = root[at(v)] = root[at(root[at(v)])];
    return v;
  };
  for (const Triangle& t : march.faces) {
    root[at(find(t[1]))] = find(t[0]);
    root[at(find(t[2]))] = find(t[0]);
  }
  std::vector<int> piece_of(march.vertices.size(), -1), number(march.vertices.size(), -1);
  std::vector<ClosedMesh> pieces;
  for (const Triangle& t : march.faces) {
    int& piece = piece_of[at(find(t[0]))];
    if (piece < 0) {
      piece = static_cast<int>(pieces.size());
      pieces.emplace_back();
    }
    ClosedMesh& mesh = pieces[at(piece)];
    Triangle moved{};
    for (std::size_t k = 0; k < 3; ++k) {
      int& v = number[at(t[k])];
      if (v < 0) {
        v = static_cast<int>(mesh.vertices.size());
        mesh.vertices.push_back(march.vertices[at(t[k])]);
      }
      moved[k] = v;
    }
    mesh.faces.push_back(moved);
  }
  for (ClosedMesh& piece : pieces) piece.volume = volume_of(piece.vertices, piece.faces);
  pieces.erase(std::remove_if(pieces.begin(), pieces.end(), [](const ClosedMesh& p) { return !(p.volume > 0.0); }),
               pieces.end());
  std::stable_sort(pieces.begin(), pieces.end(),
                   [](const ClosedMesh& a, const ClosedMesh& b) { return a.volume > b.volume; });
  return pieces;
}

ClosedMesh with_fewer_vertices(const ClosedMesh& mesh, std::size_t target_vertices) {
  if (mesh.vertices.size() <= target_vertices) return mesh;
  std::vector<Eigen::Vector3f> vertices;
  for (const Eigen::Vector3d& v : mesh.vertices) vertices.push_back(v.cast<float>());
  // A closed surface has about twice as many faces as vertices.
  const geometry::Simplified simple = geometry::simplify(vertices, mesh.faces, 2 * target_vertices);
  ClosedMesh result;
  for (const Eigen::Vector3f& v : simple.mesh.vertices) result.vertices.push_back(v.cast<double>());
  result.faces = simple.mesh.faces;
  result.volume = mesh.volume;
  return result;
}

}  // namespace anigen::rig
