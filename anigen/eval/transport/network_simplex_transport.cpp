#include "anigen/eval/transport/network_simplex_transport.h"

#include <lemon/network_simplex.h>
#include <lemon/static_graph.h>

#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/eval/transport/mass_units.h"

namespace anigen::eval {

std::vector<PlanCell> network_simplex_cells(const RowMatrix& cost, const MassUnits& units, double& rounding) {
  using Graph = lemon::StaticDigraph;
  const int n = static_cast<int>(cost.rows()), m = static_cast<int>(cost.cols());
  // Node potentials reach (n + m) times the largest cost on top of LEMON's artificial 2^62.
  const int bits = 58 - static_cast<int>(std::ceil(std::log2(n + m + 2.0)));
  const double low = cost.minCoeff(), range = cost.maxCoeff() - low;
  const double scale = range > 0.0 ? std::ldexp(1.0, bits) / range : 0.0;

  std::vector<std::pair<int, int>> arcs;  // sources 0 to n-1, sinks behind them; arc i * m + j
  arcs.reserve(static_cast<std::size_t>(n) * static_cast<std::size_t>(m));
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < m; ++j) arcs.emplace_back(i, n + j);
  }
  Graph graph;
  graph.build(n + m, arcs.begin(), arcs.end());
  Graph::ArcMap<std::int64_t> costs(graph);
  Graph::NodeMap<std::int64_t> supply(graph);
  for (int i = 0; i < n; ++i) {
    supply[graph.node(i)] = units.supplies[static_cast<std::size_t>(i)];
    for (int j = 0; j < m; ++j) costs[graph.arc(i * m + j)] = std::llround((cost(i, j) - low) * scale);
  }
  for (int j = 0; j < m; ++j) supply[graph.node(n + j)] = -units.demands[static_cast<std::size_t>(j)];

  using Simplex = lemon::NetworkSimplex<Graph, std::int64_t, std::int64_t>;
  Simplex simplex(graph);
  simplex.costMap(costs).supplyMap(supply);
  if (simplex.run() != Simplex::OPTIMAL) throw Error("the network simplex found no optimal transport plan");

  // Half a step for every unit of this plan, half a step for every unit of the true optimum; as much again for the
  // rounding of the products themselves.
  rounding = scale > 0.0 ? 2.0 * static_cast<double>(units.total) / scale : 0.0;
  std::vector<PlanCell> cells;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < m; ++j) {
      const std::int64_t flow = simplex.flow(graph.arc(i * m + j));
      if (flow > 0) cells.push_back({i, j, static_cast<double>(flow)});
    }
  }
  return cells;
}

TransportPlan network_simplex_transport(const Eigen::MatrixXd& cost, const Eigen::VectorXd& a,
                                        const Eigen::VectorXd& b) {
  check_transport(cost, a, b);
  const MassUnits units = mass_units(a, b);
  double rounding = 0.0;
  TransportPlan result{Eigen::MatrixXd::Zero(cost.rows(), cost.cols()), 0.0};
  const double unit = a.sum() / static_cast<double>(units.total);
  for (const PlanCell& cell : network_simplex_cells(cost, units, rounding)) {
    result.plan(cell.row, cell.column) = cell.mass * unit;
    result.cost += cell.mass * cost(cell.row, cell.column);
  }
  result.cost *= unit;
  return result;
}

}  // namespace anigen::eval
