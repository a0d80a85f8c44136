#include "anigen/geometry/min_cut.h"

#include <lemon/preflow.h>
#include <lemon/static_graph.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "anigen/core/error.h"

namespace anigen::geometry {
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
  int of(std::int32_t node) const { return place_[static_cast<std::size_t>(node)]; }

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
  reaches[static_cast<std::size_t>(sink)] = 1;
  const auto visit = [&](Graph::Node node, bool has_capacity_left) {
    char& mark = reaches[static_cast<std::size_t>(Graph::id(node))];
    if (!has_capacity_left || mark != 0) return;
    mark = 1;
    queue.push_back(Graph::id(node));
  };
  for (std::size_t next = 0; next < queue.size(); ++next) {
    const Graph::Node node = Graph::node(queue[next]);
    for (Graph::InArcIt arc(graph, node); arc != lemon::INVALID; ++arc) {
      visit(graph.source(arc), flow[arc] < capacities[arc]);
    }
    for (Graph::OutArcIt arc(graph, node); arc != lemon::INVALID; ++arc) visit(graph.target(arc), flow[arc] > 0);
  }
  return reaches;
}

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
  for (std::size_t i = 0; i < ends.size(); ++i) {
    capacities[Graph::arc(static_cast<int>(i))] = contracted.arcs()[i].capacity;
  }
  lemon::Preflow<Graph, Capacities> preflow(graph, capacities, Graph::node(ContractedGraph::kSource),
                                            Graph::node(ContractedGraph::kSink));
  preflow.runMinCut();
  const std::vector<char> reaches = reaching_sink(graph, capacities, preflow.flowMap(), ContractedGraph::kSink);
  std::vector<char> side(nodes);
  for (std::size_t v = 0; v < nodes; ++v) {
    side[v] = reaches[static_cast<std::size_t>(contracted.of(static_cast<std::int32_t>(v)))] == 0;
  }
  return side;
}

}  // namespace anigen::geometry
