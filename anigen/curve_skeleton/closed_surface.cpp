#include "anigen/curve_skeleton/closed_surface.h"

#include <algorithm>
#include <string>
#include <tuple>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::curve_skeleton {
namespace {

[[noreturn]] void fail(const std::string& place, const std::string& problem) {
  throw InputError("", place, problem + "; only one closed surface can be contracted to a curve");
}

struct HalfEdge {
  std::int32_t from, to, face;
  bool operator<(const HalfEdge& other) const {
    return std::tie(from, to, face) < std::tie(other.from, other.to, other.face);
  }
};

}  // namespace

void require_closed_surface(const std::vector<Eigen::Vector3d>& vertices, const std::vector<Triangle>& faces) {
  if (faces.size() < 4) fail("mesh.faces", "fewer than 4 faces enclose nothing");
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    if (!vertices[v].allFinite()) fail("mesh.vertices[" + std::to_string(v) + "]", "the vertex is not finite");
  }
  std::vector<HalfEdge> edges;
  std::vector<int> faces_at(vertices.size(), 0);
  std::vector<std::int32_t> first_face(vertices.size(), -1);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const std::string place = "mesh.faces[" + std::to_string(f) + "]";
    for (std::size_t k = 0; k < 3; ++k) {
      const std::int32_t a = faces[f][k], b = faces[f][(k + 1) % 3];
      if (a < 0 || at(a) >= vertices.size()) fail(place, "there is no vertex " + std::to_string(a));
      if (a == b) fail(place, "it names a vertex twice");
      edges.push_back({a, b, static_cast<std::int32_t>(f)});
      ++faces_at[at(a)];
      first_face[at(a)] = static_cast<std::int32_t>(f);
    }
  }
  std::sort(edges.begin(), edges.end());
  /// The face that has the directed edge, -1 without one.
  const auto face_of = [&](std::int32_t from, std::int32_t to) {
    const auto found = std::lower_bound(edges.begin(), edges.end(), HalfEdge{from, to, -1});
    return found != edges.end() && found->from == from && found->to == to ? found->face : -1;
  };
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const bool repeated = e > 0 && edges[e].from == edges[e - 1].from && edges[e].to == edges[e - 1].to;
    if (repeated || face_of(edges[e].to, edges[e].from) < 0) {
      fail("edge " + std::to_string(edges[e].from) + "–" + std::to_string(edges[e].to),
           "it does not have two faces of opposite direction");
    }
  }
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    const std::string place = "mesh.vertices[" + std::to_string(v) + "]";
    if (first_face[v] < 0) fail(place, "no face uses it");
    int turned = 0;
    std::int32_t face = first_face[v];
    do {
      const Triangle& t = faces[at(face)];
      const auto k = static_cast<std::size_t>(std::find(t.begin(), t.end(), static_cast<std::int32_t>(v)) - t.begin());
      face = face_of(static_cast<std::int32_t>(v), t[(k + 2) % 3]);
      ++turned;
    } while (face != first_face[v] && turned <= faces_at[v]);
    if (turned != faces_at[v]) fail(place, "its faces form several fans");
  }
  std::vector<char> seen(faces.size(), 0);
  std::vector<std::int32_t> open{0};
  std::size_t count = 1;
  seen[0] = 1;
  while (!open.empty()) {
    const Triangle t = faces[at(open.back())];
    open.pop_back();
    for (std::size_t k = 0; k < 3; ++k) {
      const std::int32_t next = face_of(t[(k + 1) % 3], t[k]);
      if (seen[at(next)] != 0) continue;
      seen[at(next)] = 1;
      ++count;
      open.push_back(next);
    }
  }
  if (count != faces.size()) fail("mesh", "it has several pieces");
}

}  // namespace anigen::curve_skeleton
