#include "anigen/geometry/hidden_faces.h"

#include <lemon/preflow.h>
#include <lemon/static_graph.h>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::geometry {

std::vector<Triangle> proper_faces(const std::vector<Triangle>& faces) {
  std::vector<Triangle> result;
  result.reserve(faces.size());
  std::copy_if(faces.begin(), faces.end(), std::back_inserter(result),
               [](const Triangle& face) { return face[0] != face[1] && face[1] != face[2] && face[2] != face[0]; });
  return result;
}

std::vector<std::vector<std::int32_t>> face_components(const MeshEdges& edges, std::size_t faces,
                                                       const FaceMarks& chosen) {
  FaceMarks waiting = chosen.empty() ? FaceMarks(faces, 1) : chosen;
  std::vector<std::vector<std::int32_t>> components;
  for (std::size_t start = 0; start < faces; ++start) {
    if (waiting[start] == 0) continue;
    waiting[start] = 0;
    std::vector<std::int32_t> component{static_cast<std::int32_t>(start)};
    for (std::size_t next = 0; next < component.size(); ++next) {
      for (std::size_t side = 0; side < 3; ++side) {
        const std::int32_t edge = edges.of_face(at(component[next]), side);
        if (edge < 0) continue;
        for (const std::int32_t face : edges.faces(at(edge))) {
          if (waiting[at(face)] == 0) continue;
          waiting[at(face)] = 0;
          component.push_back(face);
        }
      }
    }
    std::sort(component.begin(), component.end());
    components.push_back(std::move(component));
  }
  return components;
}

Mesh chosen_faces(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                  const FaceMarks& chosen) {
  constexpr std::int32_t kUnused = -1;
  Mesh mesh;
  std::vector<std::int32_t> place(vertices.size(), kUnused);
  for (std::size_t f = 0; f < faces.size(); ++f) {
    if (chosen[f] == 0) continue;
    mesh.faces.push_back(faces[f]);
    for (const std::int32_t vertex : faces[f]) place[at(vertex)] = 0;
  }
  for (std::size_t v = 0; v < vertices.size(); ++v) {
    if (place[v] == kUnused) continue;
    place[v] = static_cast<std::int32_t>(mesh.vertices.size());
    mesh.vertices.push_back(vertices[v]);
  }
  for (Triangle& face : mesh.faces) {
    for (std::int32_t& vertex : face) vertex = place[at(vertex)];
  }
  return mesh;
}

namespace {

using Graph = lemon::StaticDigraph;
using Units = std::int64_t;
using Capacities = Graph::ArcMap<Units>;

constexpr double kUnitsPerCapacity = 1e9;

struct Arc {
  int from, to;
  Units capacity;
};

/// The cut between what is left after nodes whose side is plain have been made one with source or sink: a node whose
/// edges together cost less than its edge to the source is on the source's side in every cheapest cut. In a mesh that
/// are nearly all nodes with such an edge, and flow that could only return is never sent.
class ContractedGraph {
 public:
  ContractedGraph(std::size_t nodes, const std::vector<CutEdge>& edges, const std::vector<std::int32_t>& sources,
                  const std::vector<std::int32_t>& sinks)
      : limit_(static_cast<double>(nodes)), place_(nodes, kFree) {
    std::vector<double> around(nodes, 0.0);
    for (const CutEdge& edge : edges) {
      if (!(edge.capacity >= 0.0)) throw InputError("", "graph", "a capacity is negative or not a number");
      for (const std::int32_t node : {edge.a, edge.b}) around[checked(node)] += edge.capacity;
    }
    std::vector<char> roles(nodes, 0);
    for (const std::int32_t node : sources) roles[checked(node)] |= 1;
    for (const std::int32_t node : sinks) roles[checked(node)] |= 2;
    for (std::size_t v = 0; v < nodes; ++v) {
      if (roles[v] == 1 && around[v] < 1.0) place_[v] = kSource;
      if (roles[v] == 2 && around[v] < 1.0) place_[v] = kSink;
      if (place_[v] == kFree) place_[v] = kFirst + count_++;
    }
    for (const CutEdge& edge : edges) add(of(edge.a), of(edge.b), edge.capacity);
    for (const std::int32_t node : sources) add(kSource, of(node), 1.0);
    for (const std::int32_t node : sinks) add(kSink, of(node), 1.0);
    // A static graph wants its arcs by the node they leave.
    std::stable_sort(arcs_.begin(), arcs_.end(), [](const Arc& a, const Arc& b) { return a.from < b.from; });
  }

  static constexpr int kSource = 0, kSink = 1;
  int size() const { return kFirst + count_; }
  const std::vector<Arc>& arcs() const { return arcs_; }
  /// The node of the contracted graph that stands for a node.
  int of(std::int32_t node) const { return place_[at(node)]; }

 private:
  static constexpr int kFirst = 2, kFree = -1;

  std::size_t checked(std::int32_t node) const {
    if (node >= 0 && static_cast<std::size_t>(node) < place_.size()) return static_cast<std::size_t>(node);
    throw InputError("", "graph", "there is no node " + std::to_string(node));
  }

  /// Both ways, but for arcs into the source and out of the sink, which nothing flows along.
  void add(int a, int b, double capacity) {
    if (a == b) return;
    const Units units = std::llround(std::min(capacity, limit_) * kUnitsPerCapacity);
    if (b != kSource && a != kSink) arcs_.push_back({a, b, units});
    if (a != kSource && b != kSink) arcs_.push_back({b, a, units});
  }

  double limit_;
  std::vector<int> place_;
  int count_ = 0;
  std::vector<Arc> arcs_;
};

/// Nodes from which the sink can still be reached, by following arcs with capacity left backwards from it.
template <typename Flow>
std::vector<char> reaching_sink(const Graph& graph, const Capacities& capacities, const Flow& flow, int sink) {
  std::vector<char> reaches(static_cast<std::size_t>(graph.nodeNum()), 0);
  std::vector<int> queue{sink};
  reaches[at(sink)] = 1;
  const auto visit = [&](Graph::Node node, bool has_capacity_left) {
    char& mark = reaches[at(Graph::id(node))];
    if (!has_capacity_left || mark != 0) return;
    mark = 1;
    queue.push_back(Graph::id(node));
  };
  for (std::size_t next = 0; next < queue.size(); ++next) {
    const Graph::Node node = Graph::node(queue[next]);
    for (Graph::InArcIt arc(graph, node); arc != lemon::INVALID; ++arc)
      visit(graph.source(arc), flow[arc] < capacities[arc]);
    for (Graph::OutArcIt arc(graph, node); arc != lemon::INVALID; ++arc) visit(graph.target(arc), flow[arc] > 0);
  }
  return reaches;
}

using Faces = std::vector<std::int32_t>;

class HiddenFaces {
 public:
  HiddenFaces(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
              const std::vector<float>& visibility, const HiddenFaceRules& rules)
      : vertices_(vertices), edges_(faces, vertices.size()), visibility_(visibility), rules_(rules) {}

  FaceMarks run() const {
    FaceMarks hidden(visibility_.size(), 0);
    Faces inner;
    for (std::size_t f = 0; f < visibility_.size(); ++f) {
      if (visibility_[f] == 0.0f) inner.push_back(static_cast<std::int32_t>(f));
    }
    if (inner.empty()) return hidden;
    const FaceMarks candidates = source_side_of_min_cut(visibility_.size(), dual_edges(), inner, outer_faces());
    for (const Faces& part : face_components(edges_, visibility_.size(), candidates)) {
      if (median_visibility(part) > rules_.visible_part) continue;
      if (largest_new_hole(part) > rules_.largest_hole) continue;
      for (const std::int32_t face : part) hidden[at(face)] = 1;
    }
    return hidden;
  }

 private:
  Eigen::Vector3d position(std::int32_t vertex) const { return vertices_[at(vertex)].cast<double>(); }

  std::vector<float> visibility_of(const Faces& part) const {
    std::vector<float> values;
    values.reserve(part.size());
    for (const std::int32_t face : part) values.push_back(visibility_[at(face)]);
    return values;
  }

  double median_visibility(const Faces& part) const {
    std::vector<float> values = visibility_of(part);
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>((values.size() - 1) / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
  }

  Faces outer_faces() const {
    Faces outer;
    for (const Faces& component : face_components(edges_, visibility_.size())) {
      const double threshold =
          std::clamp(percentile(visibility_of(component), 75.0), rules_.least_outer, rules_.most_outer);
      std::copy_if(component.begin(), component.end(), std::back_inserter(outer),
                   [&](std::int32_t face) { return visibility_[at(face)] > threshold; });
    }
    return outer;
  }

  /// Faces on both sides of the mesh's edges; longer edges are dearer to cut.
  std::vector<CutEdge> dual_edges() const {
    std::vector<CutEdge> dual;
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      const MeshEdges::Faces faces = edges_.faces(e);
      if (faces.size() != 2) continue;
      dual.push_back({faces.first[0], faces.first[1], (position(edges_[e][0]) - position(edges_[e][1])).norm()});
    }
    return dual;
  }

  /// Edges on the border of the part that were not on the border of the mesh.
  std::vector<MeshEdges::Edge> new_border(const Faces& part) const {
    std::map<std::int32_t, std::size_t> sides;
    for (const std::int32_t face : part) {
      for (std::size_t side = 0; side < 3; ++side) {
        const std::int32_t edge = edges_.of_face(at(face), side);
        if (edge >= 0) ++sides[edge];
      }
    }
    std::vector<MeshEdges::Edge> border;
    for (const auto& [edge, count] : sides) {
      if (count == 1 && edges_.faces(at(edge)).size() > 1) border.push_back(edges_[at(edge)]);
    }
    return border;
  }

  double largest_new_hole(const Faces& part) const {
    double largest = 0.0;
    for (const std::vector<MeshEdges::Edge>& loop : connected_edges(new_border(part)))
      largest = std::max(largest, fan_area(loop));
    return largest;
  }

  static std::vector<std::vector<MeshEdges::Edge>> connected_edges(const std::vector<MeshEdges::Edge>& edges) {
    std::multimap<std::int32_t, std::size_t> at_vertex;
    for (std::size_t e = 0; e < edges.size(); ++e) {
      for (const std::int32_t vertex : edges[e]) at_vertex.emplace(vertex, e);
    }
    std::vector<char> taken(edges.size(), 0);
    std::vector<std::vector<MeshEdges::Edge>> groups;
    for (std::size_t start = 0; start < edges.size(); ++start) {
      if (taken[start] != 0) continue;
      taken[start] = 1;
      std::vector<MeshEdges::Edge> group{edges[start]};
      for (std::size_t next = 0; next < group.size(); ++next) {
        const MeshEdges::Edge edge = group[next];
        for (const std::int32_t vertex : edge) {
          const auto [first, last] = at_vertex.equal_range(vertex);
          for (auto other = first; other != last; ++other) {
            if (taken[other->second] != 0) continue;
            taken[other->second] = 1;
            group.push_back(edges[other->second]);
          }
        }
      }
      groups.push_back(std::move(group));
    }
    return groups;
  }

  /// Of the triangles between the edges and the mean of their middles.
  double fan_area(const std::vector<MeshEdges::Edge>& loop) const {
    Eigen::Vector3d center = Eigen::Vector3d::Zero();
    for (const auto& [a, b] : loop) center += 0.5 * (position(a) + position(b));
    center /= static_cast<double>(loop.size());
    double area = 0.0;
    for (const auto& [a, b] : loop) area += 0.5 * (position(a) - center).cross(position(b) - center).norm();
    return area;
  }

  const std::vector<Eigen::Vector3f>& vertices_;
  MeshEdges edges_;
  const std::vector<float>& visibility_;
  HiddenFaceRules rules_;
};

}  // namespace

std::vector<char> source_side_of_min_cut(std::size_t nodes, const std::vector<CutEdge>& edges,
                                         const std::vector<std::int32_t>& sources,
                                         const std::vector<std::int32_t>& sinks) {
  const ContractedGraph contracted(nodes, edges, sources, sinks);
  std::vector<std::pair<int, int>> ends;
  ends.reserve(contracted.arcs().size());
  for (const Arc& arc : contracted.arcs()) ends.emplace_back(arc.from, arc.to);
  Graph graph;
  graph.build(contracted.size(), ends.begin(), ends.end());
  Capacities capacities(graph);
  for (std::size_t i = 0; i < ends.size(); ++i)
    capacities[Graph::arc(static_cast<int>(i))] = contracted.arcs()[i].capacity;
  lemon::Preflow<Graph, Capacities> preflow(graph, capacities, Graph::node(ContractedGraph::kSource),
                                            Graph::node(ContractedGraph::kSink));
  preflow.runMinCut();
  const std::vector<char> reaches = reaching_sink(graph, capacities, preflow.flowMap(), ContractedGraph::kSink);
  std::vector<char> side(nodes);
  for (std::size_t v = 0; v < nodes; ++v) side[v] = reaches[at(contracted.of(static_cast<std::int32_t>(v)))] == 0;
  return side;
}

FaceMarks hidden_faces(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                       const std::vector<float>& visibility, const HiddenFaceRules& rules) {
  if (visibility.size() != faces.size()) {
    throw InputError("", "visibility",
                     std::to_string(visibility.size()) + " values for " + std::to_string(faces.size()) + " faces");
  }
  return HiddenFaces(vertices, faces, visibility, rules).run();
}

}  // namespace anigen::geometry
