#include "anigen/asset/mesh_shells.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>
#include <utility>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/numeric.h"

namespace anigen {

namespace {

/// The first vertex, in an order of places, that lies where each vertex lies. Places that are not numbers stay apart.
std::vector<std::int32_t> welded_vertices(const std::vector<Eigen::Vector3f>& vertices) {
  std::vector<std::int32_t> order;
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    if (vertices[v].allFinite()) order.push_back(static_cast<std::int32_t>(v));
  }
  const auto key = [&](std::int32_t v) {
    const Eigen::Vector3f& p = vertices[at(v)];
    return std::make_tuple(p.x(), p.y(), p.z());
  };
  std::stable_sort(order.begin(), order.end(), [&](std::int32_t a, std::int32_t b) { return key(a) < key(b); });
  std::vector<std::int32_t> welded(vertices.size());
  std::iota(welded.begin(), welded.end(), 0);
  for (std::size_t i = 1; i < order.size(); ++i) {
    if (key(order[i]) == key(order[i - 1])) welded[at(order[i])] = welded[at(order[i - 1])];
  }
  return welded;
}

/// A face around an edge.
struct FaceAtEdge {
  std::int32_t face;
  std::int64_t angle;  ///< around the edge, in steps of kAngleStep, in [0, 2 pi)
  bool forward;        ///< it names the edge's lower vertex before the higher one: its solid lies at smaller angles
};

constexpr double kAngleStep = 1e-5;

/// The faces at an edge in the order of their angles, at equal ones those whose solid ends before those whose solid
/// begins; nothing where a face has no angle.
std::vector<FaceAtEdge> around_edge(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& places,
                                    const MeshEdges::Edge& edge, const MeshEdges::Faces& beside) {
  const Eigen::Vector3d from = vertices[at(edge[0])].cast<double>();
  const Eigen::Vector3d along = vertices[at(edge[1])].cast<double>() - from;
  const Eigen::Vector3d axis = along.normalized(), u = axis.unitOrthogonal(), v = axis.cross(u);
  std::vector<FaceAtEdge> around;
  for (const std::int32_t face : beside) {
    const Triangle& corners = places[at(face)];
    for (std::size_t k = 0; k < 3; ++k) {
      const bool forward = corners[k] == edge[0] && corners[(k + 1) % 3] == edge[1];
      const bool backward = corners[k] == edge[1] && corners[(k + 1) % 3] == edge[0];
      if (!forward && !backward) continue;
      const Eigen::Vector3d aside = vertices[at(corners[(k + 2) % 3])].cast<double>() - from;
      const double x = aside.dot(u), y = aside.dot(v);
      if (!(x * x + y * y > 0.0)) return {};
      const auto turn = static_cast<std::int64_t>(std::llround(2.0 * kPi / kAngleStep));
      const auto steps = static_cast<std::int64_t>(std::llround(std::atan2(y, x) / kAngleStep));
      around.push_back({face, ((steps % turn) + turn) % turn, forward});
    }
  }
  std::sort(around.begin(), around.end(), [](const FaceAtEdge& a, const FaceAtEdge& b) {
    return std::make_tuple(a.angle, !a.forward, a.face) < std::make_tuple(b.angle, !b.forward, b.face);
  });
  return around;
}

/// Pairs of faces between which a solid lies: of each that faces smaller angles the next one that faces greater ones.
/// All with the first where the faces do not alternate so: better one part too few than a part that tears.
std::vector<std::pair<std::int32_t, std::int32_t>> solids_at_edge(const std::vector<FaceAtEdge>& around,
                                                                  const MeshEdges::Faces& beside) {
  std::vector<std::pair<std::int32_t, std::int32_t>> pairs;
  bool alternates = !around.empty() && around.size() % 2 == 0;
  for (std::size_t i = 0; i < around.size() && alternates; ++i) {
    const FaceAtEdge& next = around[(i + 1) % around.size()];
    alternates = around[i].forward != next.forward;
    if (!around[i].forward) pairs.emplace_back(around[i].face, next.face);
  }
  if (alternates) return pairs;
  pairs.clear();
  for (const std::int32_t face : beside) pairs.emplace_back(*beside.begin(), face);
  return pairs;
}

}  // namespace

MeshShells mesh_shells(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces) {
  const MeshEdges checked(faces, vertices.size());  // refuses faces of missing vertices
  const std::vector<std::int32_t> welded = welded_vertices(vertices);
  std::vector<Triangle> places = faces;
  for (Triangle& face : places) {
    for (std::int32_t& corner : face) corner = welded[at(corner)];
  }
  DisjointSets sets(vertices.size());
  for (const Triangle& face : faces) {
    sets.join(at(face[0]), at(face[1]));
    sets.join(at(face[0]), at(face[2]));
  }
  const MeshEdges edges(places, vertices.size());
  for (std::size_t edge = 0; edge < edges.size(); ++edge) {
    const MeshEdges::Faces beside = edges.faces(edge);
    if (beside.size() < 2) continue;
    std::vector<std::pair<std::int32_t, std::int32_t>> joined{{*beside.begin(), *(beside.begin() + 1)}};
    if (beside.size() > 2) joined = solids_at_edge(around_edge(vertices, places, edges[edge], beside), beside);
    for (const auto& [first, second] : joined) sets.join(at(faces[at(first)][0]), at(faces[at(second)][0]));
  }
  MeshShells shells;
  shells.of_vertex.assign(vertices.size(), -1);
  std::vector<std::int32_t> number(vertices.size(), -1);
  for (const Triangle& face : faces) {
    std::int32_t& shell = number[sets.find(at(face[0]))];
    if (shell < 0) shell = static_cast<std::int32_t>(shells.count++);
    shells.of_face.push_back(shell);
    for (const std::int32_t corner : face) shells.of_vertex[at(corner)] = shell;
  }
  return shells;
}

}  // namespace anigen
