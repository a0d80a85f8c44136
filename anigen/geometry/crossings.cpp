#include "anigen/geometry/crossings.h"

#include <algorithm>
#include <cstdint>

#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/triangle_tree.h"

namespace anigen::geometry {

namespace {

/// Edges that one task asks about: enough that starting it costs nothing beside its rays.
constexpr std::size_t kEdgesPerTask = 1024;
/// Part of an edge at either end in which hits do not count: vertices that rest on a face are no crossing.
constexpr float kEdgeEnd = 1e-3f;
/// Step past a hit, as a part of the edge: larger than the rounding of the distances.
constexpr float kPastHit = 1e-5f;
/// Faces that one edge is followed through; those at its two ends are among them.
constexpr int kMostHits = 24;

bool shares_vertex(const Triangle& face, const MeshEdges::Edge& edge) {
  return std::any_of(face.begin(), face.end(), [&edge](std::int32_t v) { return v == edge[0] || v == edge[1]; });
}

/// Appends the faces that an edge pierces.
void append_pierced(const TriangleTree& tree, const std::vector<Eigen::Vector3f>& vertices,
                    const std::vector<Triangle>& faces, const MeshEdges::Edge& edge,
                    std::vector<std::int32_t>& pierced) {
  const Eigen::Vector3f& from = vertices[at(edge[0])];
  const Eigen::Vector3f along = vertices[at(edge[1])] - from;
  if (!(along.squaredNorm() > 0.0f)) return;
  float begin = kEdgeEnd;
  for (int hit = 0; hit < kMostHits && begin < 1.0f - kEdgeEnd; ++hit) {
    const TreeHit pierced_face = tree.first_hit({from, along, begin, 1.0f - kEdgeEnd});
    if (!pierced_face.found()) return;
    if (!shares_vertex(faces[pierced_face.face], edge)) pierced.push_back(static_cast<std::int32_t>(pierced_face.face));
    begin = std::max(begin, pierced_face.distance) + kPastHit;
  }
}

}  // namespace

FaceMarks crossed_faces(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                        const MeshEdges& edges) {
  FaceMarks crossed(faces.size(), 0);
  if (faces.empty()) return crossed;
  const TriangleTree tree(vertices, faces);
  const std::size_t tasks = (edges.size() + kEdgesPerTask - 1) / kEdgesPerTask;
  std::vector<std::vector<std::int32_t>> found(tasks);
  parallel_for(tasks, [&](std::size_t task) {
    const std::size_t end = std::min(edges.size(), (task + 1) * kEdgesPerTask);
    for (std::size_t e = task * kEdgesPerTask; e < end; ++e) {
      const std::size_t before = found[task].size();
      append_pierced(tree, vertices, faces, edges[e], found[task]);
      if (found[task].size() == before) continue;
      for (const std::int32_t face : edges.faces(e)) found[task].push_back(face);
    }
  });
  for (const std::vector<std::int32_t>& list : found) {
    for (const std::int32_t face : list) crossed[at(face)] = 1;
  }
  return crossed;
}

}  // namespace anigen::geometry
