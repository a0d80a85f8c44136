#include <algorithm>
#include <numeric>
#include <unordered_map>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/io/meshes/mesh_check.h"
#include "anigen/io/meshes/obj_file.h"
#include "anigen/io/obj.h"

namespace anigen::io {
namespace {

constexpr std::uintmax_t kMostObjBytes = std::uintmax_t{2} << 30;

// For every entry the first one with the same numbers: tools that write a normal per corner repeat most of them,
// and vertices should split only where something differs.
template <typename Vector>
std::vector<std::int64_t> first_equal(const std::vector<Vector>& entries) {
  const auto less = [&](std::int64_t a, std::int64_t b) {
    const Vector& va = entries[static_cast<std::size_t>(a)];
    const Vector& vb = entries[static_cast<std::size_t>(b)];
    for (Eigen::Index k = 0; k < va.size(); ++k) {
      if (va[k] != vb[k]) return va[k] < vb[k];
    }
    return false;
  };
  std::vector<std::int64_t> order(entries.size()), first(entries.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), less);
  for (std::size_t i = 0; i < order.size(); ++i) {
    const bool repeats = i > 0 && !less(order[i - 1], order[i]);
    first[static_cast<std::size_t>(order[i])] = repeats ? first[static_cast<std::size_t>(order[i - 1])] : order[i];
  }
  return first;
}

struct CornerHash {
  std::size_t operator()(const ObjFile::Corner& corner) const {
    std::uint64_t hash = 0;
    for (const std::int64_t index : corner) hash = (hash ^ static_cast<std::uint64_t>(index)) * 0x9E3779B97F4A7C15u + 1;
    return static_cast<std::size_t>(hash ^ hash >> 32);
  }
};

// The first corner at a position keeps the position's number, so a file without seams keeps its vertex order;
// other combinations of texture coordinate and normal become vertices behind the last.
class VertexSplitter {
 public:
  VertexSplitter(const ObjFile& obj, const std::string& file)
      : obj_(obj),
        file_(file),
        first_use_(obj.positions.size(), kUnused),
        uv_(first_equal(obj.uvs)),
        normal_(first_equal(obj.normals)) {
    for (std::size_t v = 0; v < obj.positions.size(); ++v) vertices_.push_back({static_cast<std::int64_t>(v), -1, -1});
  }

  std::int32_t vertex(ObjFile::Corner corner) {
    if (corner[1] >= 0) corner[1] = uv_[static_cast<std::size_t>(corner[1])];
    if (corner[2] >= 0) corner[2] = normal_[static_cast<std::size_t>(corner[2])];
    const auto position = static_cast<std::size_t>(corner[0]);
    if (first_use_[position] == kUnused) {
      first_use_[position] = 1;
      vertices_[position] = corner;
    }
    if (vertices_[position] == corner) return face_index(position, file_);
    const auto [entry, is_new] = split_.try_emplace(corner, 0);
    if (is_new) {
      entry->second = face_index(vertices_.size(), file_);
      vertices_.push_back(corner);
    }
    return entry->second;
  }

  const std::vector<ObjFile::Corner>& vertices() const { return vertices_; }

 private:
  static constexpr char kUnused = 0;
  const ObjFile& obj_;
  const std::string& file_;
  std::vector<char> first_use_;
  std::vector<std::int64_t> uv_, normal_;
  std::vector<ObjFile::Corner> vertices_;
  std::unordered_map<ObjFile::Corner, std::int32_t, CornerHash> split_;
};

void add_faces(const ObjFile& obj, VertexSplitter& splitter, Mesh& mesh) {
  for (std::size_t p = 0; p < obj.polygons.size(); ++p) {
    const std::size_t begin = obj.polygons[p].first_corner;
    const std::size_t end = p + 1 < obj.polygons.size() ? obj.polygons[p + 1].first_corner : obj.corners.size();
    const std::int32_t hub = splitter.vertex(obj.corners[begin]);
    std::int32_t previous = splitter.vertex(obj.corners[begin + 1]);
    for (std::size_t c = begin + 2; c < end; ++c) {
      const std::int32_t next = splitter.vertex(obj.corners[c]);
      mesh.faces.push_back({hub, previous, next});
      previous = next;
    }
  }
}

void add_vertices(const ObjFile& obj, const std::vector<ObjFile::Corner>& vertices, Mesh& mesh) {
  const auto names = [&](std::size_t part) {
    return std::any_of(vertices.begin(), vertices.end(), [part](const ObjFile::Corner& c) { return c[part] >= 0; });
  };
  const bool has_uvs = names(1), has_normals = names(2);
  for (const ObjFile::Corner& corner : vertices) {
    mesh.vertices.push_back(obj.positions[static_cast<std::size_t>(corner[0])]);
    if (!obj.colors.empty()) mesh.colors.push_back(obj.colors[static_cast<std::size_t>(corner[0])]);
    if (has_uvs) {
      mesh.uvs.push_back(corner[1] >= 0 ? obj.uvs[static_cast<std::size_t>(corner[1])] : Eigen::Vector2f::Zero());
    }
  }
  if (!has_normals) return;
  mesh.normals = vertex_normals(mesh.vertices, mesh.faces);  // for corners that name none
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    if (vertices[v][2] >= 0) mesh.normals[v] = unit_normal(obj.normals[static_cast<std::size_t>(vertices[v][2])]);
  }
}

}  // namespace

Mesh read_obj(const std::filesystem::path& path) {
  const std::string file = path.string();
  const ObjFile obj = parse_obj(read_file(path, kMostObjBytes), file);
  if (obj.positions.empty()) throw InputError(file, "", "no vertices: not an OBJ file, or an empty one");
  Mesh mesh;
  VertexSplitter splitter(obj, file);
  add_faces(obj, splitter, mesh);
  add_vertices(obj, splitter.vertices(), mesh);
  return mesh;
}

}  // namespace anigen::io
