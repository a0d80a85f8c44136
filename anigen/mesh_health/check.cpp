#include "anigen/mesh_health/check.h"

#include <algorithm>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/numeric.h"
#include "anigen/mesh_health/parts.h"
#include "anigen/mesh_health/self_intersections.h"
#include "anigen/mesh_health/weld.h"

namespace anigen::mesh_health {

namespace {

void count_edges(const WeldedMesh& welded, const MeshEdges& edges, MeshFigures& figures) {
  DisjointSets chains(welded.places.size());
  std::vector<char> on_border(welded.places.size(), 0);
  double length = 0.0;
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const auto around = edges.faces(e);
    const auto [a, b] = edges[e];
    length += (welded.places[at(a)] - welded.places[at(b)]).cast<double>().norm();
    if (around.size() == 1) {
      ++figures.border_edges;
      on_border[at(a)] = on_border[at(b)] = 1;
      chains.join(at(a), at(b));
    } else if (around.size() > 2) {
      ++figures.non_manifold_edges;
    } else if (runs_upward(welded.faces[at(around.begin()[0])], edges[e]) ==
               runs_upward(welded.faces[at(around.begin()[1])], edges[e])) {
      ++figures.misoriented_edges;
    }
  }
  for (std::size_t p = 0; p < welded.places.size(); ++p) figures.borders += on_border[p] != 0 && chains.find(p) == p;
  if (edges.size() > 0) figures.mean_edge = length / static_cast<double>(edges.size());
}

/// Vertices whose faces do not all hang together by edges at the vertex.
std::size_t count_split_vertices(const WeldedMesh& welded, const MeshEdges& edges) {
  DisjointSets corners(3 * welded.faces.size());
  const auto corner = [&](std::int32_t face, std::int32_t place) {
    const Triangle& t = welded.faces[at(face)];
    return 3 * at(face) + static_cast<std::size_t>(std::find(t.begin(), t.end(), place) - t.begin());
  };
  for (std::size_t e = 0; e < edges.size(); ++e) {
    const auto around = edges.faces(e);
    for (const std::int32_t place : edges[e])
      for (const std::int32_t face : around) corners.join(corner(*around.begin(), place), corner(face, place));
  }
  std::vector<std::size_t> fans(welded.places.size(), 0);
  for (std::size_t f = 0; f < welded.faces.size(); ++f)
    for (std::size_t k = 0; k < 3; ++k) fans[at(welded.faces[f][k])] += corners.find(3 * f + k) == 3 * f + k;
  return static_cast<std::size_t>(std::count_if(fans.begin(), fans.end(), [](std::size_t n) { return n > 1; }));
}

class Findings {
 public:
  explicit Findings(MeshFigures& figures) : figures_(figures) {}

  void add(const char* code, std::size_t count, const char* one, const char* several) {
    if (count == 0) return;
    figures_.findings.push_back({code, count, std::to_string(count) + " " + (count == 1 ? one : several)});
  }

 private:
  MeshFigures& figures_;
};

void judge(const CheckOptions& options, MeshFigures& figures) {
  Findings found(figures);
  found.add("non-manifold-edges", figures.non_manifold_edges, "non-manifold edge", "non-manifold edges");
  found.add("non-manifold-vertices", figures.non_manifold_vertices, "non-manifold vertex", "non-manifold vertices");
  found.add("misoriented-edges", figures.misoriented_edges, "edge between faces of opposite orientation",
            "edges between faces of opposite orientation");
  found.add("inverted-parts", figures.inverted_parts, "closed part inside out", "closed parts inside out");
  found.add("degenerate-faces", figures.degenerate_faces, "degenerate face", "degenerate faces");
  found.add("duplicate-faces", figures.duplicate_faces, "duplicate face", "duplicate faces");
  found.add("isolated-vertices", figures.isolated_vertices, "isolated vertex", "isolated vertices");
  found.add("self-intersections", figures.crossed_faces, "face that crosses its own part",
            "faces that cross their own part");
  if (options.solid) {
    found.add("part-intersections", figures.crossed_parts_faces, "face that crosses another part",
              "faces that cross other parts");
    found.add("open-borders", figures.border_edges, "border edge", "border edges");
  }
  std::string& verdict = figures.verdict = figures.findings.empty() ? "sound" : "not sound: ";
  for (const MeshFinding& finding : figures.findings)
    verdict += (&finding == &figures.findings.front() ? "" : ", ") + finding.phrase;
  const std::string borders = std::to_string(figures.borders) + (figures.borders == 1 ? " border" : " borders");
  const std::string parts = std::to_string(figures.parts) + (figures.parts == 1 ? " part" : " parts");
  verdict += figures.closed ? "; closed, " + parts : "; open, " + parts + ", " + borders;
  if (!options.solid && figures.crossed_parts_faces > 0)
    verdict += ", " + std::to_string(figures.crossed_parts_faces) + " faces cross other parts";
  if (!figures.intersections_known) verdict += "; crossing faces were not looked for";
}

}  // namespace

MeshFigures check_mesh(const Mesh& mesh, const CheckOptions& options) {
  const WeldedMesh welded = weld(mesh);
  const MeshEdges edges(welded.faces, welded.places.size());
  const Parts parts = find_parts(welded.places, welded.faces, edges);
  MeshFigures figures;
  figures.vertices = mesh.vertices.size();
  figures.places = welded.places.size();
  figures.faces = mesh.faces.size();
  figures.isolated_vertices = welded.isolated_vertices;
  figures.duplicate_faces = welded.duplicate_faces;
  figures.degenerate_faces = welded.collapsed_faces;
  for (const Triangle& face : welded.faces) {
    figures.area += 0.5 * area_vector(welded.places, face).norm();
    figures.degenerate_faces += is_degenerate(welded.places, face);
    for (const std::int32_t v : face) figures.box.extend(welded.places[at(v)].cast<double>());
  }
  count_edges(welded, edges, figures);
  figures.non_manifold_vertices = count_split_vertices(welded, edges);
  figures.parts = parts.size();
  for (std::size_t part = 0; part < parts.size(); ++part) {
    figures.closed_parts += parts.closed[part] != 0;
    figures.inverted_parts += parts.is_inverted(part);
    if (parts.closed[part] != 0) figures.volume += parts.volumes[part];
  }
  if (options.self_intersections) {
    const SelfIntersections crossings = self_intersections(welded.places, welded.faces, parts.of_face);
    const auto marked = [](const std::vector<char>& marks) {
      return marks.size() - static_cast<std::size_t>(std::count(marks.begin(), marks.end(), 0));
    };
    figures.crossings = crossings.pairs;
    figures.crossed_faces = marked(crossings.same_part);
    figures.crossed_parts_faces = marked(crossings.other_part);
    figures.intersections_known = true;
  }
  figures.closed = figures.border_edges == 0 && !welded.faces.empty();
  figures.manifold = figures.non_manifold_edges == 0 && figures.non_manifold_vertices == 0;
  figures.oriented = figures.misoriented_edges == 0 && figures.inverted_parts == 0;
  judge(options, figures);
  return figures;
}

Json to_json(const MeshFigures& figures) {
  const auto triple = [](const Eigen::Vector3d& v) { return Json{v.x(), v.y(), v.z()}; };
  Json json = {{"verdict", figures.verdict},
               {"closed", figures.closed},
               {"manifold", figures.manifold},
               {"oriented", figures.oriented},
               {"vertices", figures.vertices},
               {"places", figures.places},
               {"faces", figures.faces},
               {"parts", figures.parts},
               {"closed_parts", figures.closed_parts},
               {"border_edges", figures.border_edges},
               {"borders", figures.borders},
               {"non_manifold_edges", figures.non_manifold_edges},
               {"non_manifold_vertices", figures.non_manifold_vertices},
               {"misoriented_edges", figures.misoriented_edges},
               {"inverted_parts", figures.inverted_parts},
               {"degenerate_faces", figures.degenerate_faces},
               {"duplicate_faces", figures.duplicate_faces},
               {"isolated_vertices", figures.isolated_vertices}};
  if (figures.intersections_known) {
    json["self_intersecting_faces"] = figures.crossed_faces;
    json["part_intersecting_faces"] = figures.crossed_parts_faces;
    json["crossings"] = figures.crossings;
  }
  json["area"] = figures.area;
  json["volume"] = figures.volume;
  json["mean_edge"] = figures.mean_edge;
  if (!figures.box.empty()) {
    json["box"] = {{"low", triple(figures.box.low)}, {"high", triple(figures.box.high)}};
    json["diagonal"] = figures.box.diagonal();
  }
  json["findings"] = Json::array();
  for (const MeshFinding& finding : figures.findings)
    json["findings"].push_back({{"code", finding.code}, {"count", finding.count}});
  return json;
}

}  // namespace anigen::mesh_health
