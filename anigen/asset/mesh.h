#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace anigen {

using Triangle = std::array<std::int32_t, 3>;

/// An encoded picture as it came (PNG or JPEG bytes), kept so that export does not re-compress it.
struct EncodedImage {
  std::string name;
  std::string mime_type;  ///< "image/png" or "image/jpeg"
  std::vector<std::uint8_t> bytes;
};

/// Use that a material makes of the alpha of its base colour, as glTF says it (3.9.4). Other formats do not say.
enum class AlphaMode { kUnknown, kOpaque, kMask, kBlend };

/// The part of a glTF material that the project keeps: base colour only.
struct Material {
  std::string name;
  Eigen::Vector4f base_color = Eigen::Vector4f::Ones();  ///< linear RGBA factor
  int image = -1;  ///< index into Asset::images of the sRGB base colour texture, or -1
  bool double_sided = true;
  AlphaMode alpha_mode = AlphaMode::kUnknown;
  float alpha_cutoff = 0.5f;  ///< of kMask: lower alpha is a hole
};

/// Triangle mesh. Vertices are those of the file (split at texture seams), in order; every per-vertex array is
/// empty or as long as `vertices`.
struct Mesh {
  std::vector<Eigen::Vector3f> vertices;
  std::vector<Triangle> faces;
  std::vector<Eigen::Vector3f> normals;      ///< unit length, from the file
  std::vector<Eigen::Vector2f> uvs;          ///< glTF convention: origin at the top left
  std::vector<Eigen::Vector4f> colors;       ///< linear RGBA in [0, 1], multiplied with the material
  std::vector<std::int32_t> face_materials;  ///< per face, index into Asset::materials or -1; empty: all -1
};

struct Box {
  Eigen::Vector3d low = Eigen::Vector3d::Constant(1e300);
  Eigen::Vector3d high = Eigen::Vector3d::Constant(-1e300);
  bool empty() const { return low.x() > high.x(); }
  Eigen::Vector3d center() const { return 0.5 * (low + high); }
  double diagonal() const { return empty() ? 0.0 : (high - low).norm(); }
  double longest_side() const { return empty() ? 0.0 : (high - low).maxCoeff(); }
  void extend(const Eigen::Vector3d& p) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
};

Box bounding_box(const std::vector<Eigen::Vector3f>& points);

std::vector<Eigen::Vector3d> in_double(const std::vector<Eigen::Vector3f>& points);

/// Cross product of two sides of a face: its normal, counter-clockwise side out, times twice its area.
Eigen::Vector3d area_vector(const std::vector<Eigen::Vector3f>& vertices, const Triangle& face);

/// Unit normal of a face, counter-clockwise side out; zero without area.
Eigen::Vector3d face_normal(const std::vector<Eigen::Vector3f>& vertices, const Triangle& face);

/// Area-weighted vertex normals [V], unit length; (0, 0, 1) where no face gives one.
std::vector<Eigen::Vector3f> vertex_normals(const std::vector<Eigen::Vector3f>& vertices,
                                            const std::vector<Triangle>& faces);

/// The edges of a triangle mesh, without direction, and the faces at each: any number of them. Edges are numbered in
/// the order of (lower vertex, higher vertex). The side of a face that names a vertex twice is no edge.
class MeshEdges {
 public:
  using Edge = std::array<std::int32_t, 2>;  ///< lower vertex first

  struct Faces {
    const std::int32_t *first, *last;
    const std::int32_t* begin() const { return first; }
    const std::int32_t* end() const { return last; }
    std::size_t size() const { return static_cast<std::size_t>(last - first); }
  };

  /// @throws InputError when a face refers to a vertex that is missing
  MeshEdges(const std::vector<Triangle>& faces, std::size_t vertices);

  std::size_t size() const { return edges_.size(); }
  const Edge& operator[](std::size_t edge) const { return edges_[edge]; }
  const std::vector<Edge>& all() const { return edges_; }
  /// Ascending; a face that has the edge twice is listed twice.
  Faces faces(std::size_t edge) const { return {faces_.data() + offsets_[edge], faces_.data() + offsets_[edge + 1]}; }
  /// The edge from corner `side` of a face to the next corner; -1 where both are one vertex.
  std::int32_t of_face(std::size_t face, std::size_t side) const { return of_face_[face][side]; }
  /// -1 when no face has this edge. @pre both are vertices of the mesh
  std::int32_t find(std::int32_t a, std::int32_t b) const;

 private:
  std::vector<Edge> edges_;
  std::vector<std::size_t> offsets_{0};  ///< [E + 1]
  std::vector<std::int32_t> faces_;
  std::vector<Triangle> of_face_;        ///< [F], edges in place of vertices
  std::vector<std::size_t> first_edge_;  ///< [V + 1], by lower vertex
};

/// Vertex normals [V] in which each face counts by its angle at the vertex (Thürmer and Wüthrich 1998), as in the
/// published export (docs/reference/flows.md, 5.9); unlike those of vertex_normals() they do not depend on how a flat
/// part is cut into triangles. Unit length; (0, 0, 1) where no face with area gives one.
/// @pre faces refer to vertices that exist
std::vector<Eigen::Vector3f> angle_weighted_normals(const std::vector<Eigen::Vector3f>& vertices,
                                                    const std::vector<Triangle>& faces);

}  // namespace anigen
