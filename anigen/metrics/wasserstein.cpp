#include "anigen/metrics/wasserstein.h"

#include <lemon/network_simplex.h>
#include <lemon/static_graph.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"

namespace anigen::metrics {

namespace {

/// Below this many cells augmenting paths take milliseconds whatever the masses are.
constexpr std::size_t kFewCells = 20000;
/// Sizes closer than this leave almost every mass whole: 842 and 841 joints exchange but a share of 1/841 each.
constexpr double kNearlyEqualScales = 0.02;

bool suits_simplex(const MassUnits& units) {
  const std::size_t n = units.supplies.size(), m = units.demands.size();
  if (n * m < kFewCells) return false;
  const double larger = static_cast<double>(std::max(n, m)), smaller = static_cast<double>(std::min(n, m));
  // A multiple of the other size leaves one side with single units.
  const bool few_units = *std::max_element(units.supplies.begin(), units.supplies.end()) <= 4 ||
                         *std::max_element(units.demands.begin(), units.demands.end()) <= 4;
  return !few_units && larger > (1.0 + kNearlyEqualScales) * smaller;
}

/// Exact transport by LEMON's network simplex: mostly slower than ShortestPathTransport, but other people's code, so it
/// is the oracle of the tests, and the quicker one where masses are split into many units (TransportSolver). Costs are
/// rounded to whole numbers of at least 2^-44 of their range (with floating-point costs the simplex can cycle).
/// @param cost [n,m] finite
/// @param rounding by how much the plan's cost, in units * cost, may at most exceed the optimum
/// @return the cells of the plan, masses in units, sorted by row then column
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
    supply[graph.node(i)] = units.supplies[at(i)];
    for (int j = 0; j < m; ++j) costs[graph.arc(i * m + j)] = std::llround((cost(i, j) - low) * scale);
  }
  for (int j = 0; j < m; ++j) supply[graph.node(n + j)] = -units.demands[at(j)];

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

}  // namespace

std::vector<int> ascending(const Eigen::VectorXd& values) {
  std::vector<int> order(static_cast<std::size_t>(values.size()));
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int x, int y) { return values[x] < values[y]; });
  return order;
}

Eigen::VectorXd picked(const Eigen::VectorXd& values, const std::vector<int>& order) {
  Eigen::VectorXd result(values.size());
  for (Eigen::Index k = 0; k < values.size(); ++k) result[k] = values[order[at(k)]];
  return result;
}

std::vector<PlanCell> monotone_coupling(const MassUnits& units, const std::vector<int>& row_order,
                                        const std::vector<int>& column_order) {
  std::vector<PlanCell> cells;
  std::size_t i = 0, k = 0;
  std::int64_t supply = 0, demand = 0;
  while (true) {
    while (supply == 0 && i < row_order.size()) supply = units.supplies[at(row_order[i++])];
    while (demand == 0 && k < column_order.size()) demand = units.demands[at(column_order[k++])];
    if (supply == 0 || demand == 0) return cells;
    const std::int64_t moved = std::min(supply, demand);
    cells.push_back({row_order[i - 1], column_order[k - 1], static_cast<double>(moved)});
    supply -= moved;
    demand -= moved;
  }
}

double line_cost(const Eigen::VectorXd& x, const Eigen::VectorXd& a, const Eigen::VectorXd& y,
                 const Eigen::VectorXd& b) {
  double cost = 0.0, left = a[0], room = b[0];
  for (Eigen::Index i = 0, k = 0; i < x.size() && k < y.size();) {
    const double moved = std::min(left, room), gap = x[i] - y[k];
    cost += moved * gap * gap;
    left -= moved;
    room -= moved;
    // Both may be empty at once; the smaller remainder is exactly 0, so one index always moves on.
    if (left <= 0.0) {
      if (++i < x.size()) left = a[i];
    }
    if (room <= 0.0) {
      if (++k < y.size()) room = b[k];
    }
  }
  return cost;
}

TransportPlan exact_transport(const Eigen::MatrixXd& cost, const Eigen::VectorXd& a, const Eigen::VectorXd& b,
                              ExactSolver solver) {
  check_transport(cost, a, b);
  const MassUnits units = mass_units(a, b);
  const double unit = a.sum() / static_cast<double>(units.total);
  double rounding = 0.0;
  const std::vector<PlanCell> cells = solver == ExactSolver::kNetworkSimplex
                                          ? network_simplex_cells(cost, units, rounding)
                                      : solver == ExactSolver::kShortestPaths ? ShortestPathTransport(units).solve(cost)
                                                                              : TransportSolver(units).solve(cost);
  TransportPlan result{Eigen::MatrixXd::Zero(cost.rows(), cost.cols()), 0.0};
  for (const PlanCell& cell : cells) {
    result.plan(cell.row, cell.column) = cell.mass * unit;
    result.cost += cell.mass * cost(cell.row, cell.column);
  }
  result.cost *= unit;
  return result;
}

ShortestPathTransport::ShortestPathTransport(const MassUnits& units)
    : transposed_(units.supplies.size() < units.demands.size()),
      supplies_(transposed_ ? units.demands : units.supplies),
      demands_(transposed_ ? units.supplies : units.demands),
      rows_(static_cast<int>(supplies_.size())),
      columns_(static_cast<int>(demands_.size())),
      potential_(demands_.size(), 0.0),
      flows_(demands_.size()),
      open_distance_(demands_.size()),
      open_potential_(demands_.size()),
      previous_row_(demands_.size()),
      reached_from_(supplies_.size()),
      visited_(supplies_.size()) {}

const std::vector<PlanCell>& ShortestPathTransport::solve(const RowMatrix& cost) {
  if (transposed_) {
    transposed_cost_ = cost.transpose();
    run(transposed_cost_);
    for (PlanCell& cell : cells_) std::swap(cell.row, cell.column);
  } else {
    run(cost);
  }
  std::sort(cells_.begin(), cells_.end());
  return cells_;
}

void ShortestPathTransport::run(const RowMatrix& cost) {
  supply_left_ = supplies_;
  demand_left_ = demands_;
  for (auto& flow : flows_) flow.clear();
  if (!warm_) reduce_columns(cost);
  assign_tight(cost);
  for (int i = 0; i < rows_; ++i) {
    while (supply_left_[at(i)] > 0) augment(cost, i);
  }
  warm_ = true;

  dual_ = 0.0;
  for (int i = 0; i < rows_; ++i) {
    const Eigen::Map<const Eigen::RowVectorXd> potentials(potential_.data(), columns_);
    dual_ += static_cast<double>(supplies_[at(i)]) * (cost.row(i) - potentials).minCoeff();
  }
  cells_.clear();
  for (int j = 0; j < columns_; ++j) {
    dual_ += static_cast<double>(demands_[at(j)]) * potential_[at(j)];
    for (const Flow& flow : flows_[at(j)]) cells_.push_back({flow.row, j, static_cast<double>(flow.units)});
  }
}

void ShortestPathTransport::reduce_columns(const RowMatrix& cost) {
  for (int j = 0; j < columns_; ++j) potential_[at(j)] = cost(0, j);
  for (int i = 1; i < rows_; ++i) {
    const double* row = cost.row(i).data();
    for (int j = 0; j < columns_; ++j) potential_[at(j)] = std::min(potential_[at(j)], row[j]);
  }
}

// Every row fills its cheapest column as far as that has room.
void ShortestPathTransport::assign_tight(const RowMatrix& cost) {
  for (int i = 0; i < rows_; ++i) {
    const double* row = cost.row(i).data();
    int best = 0;
    double least = row[0] - potential_[0];
    for (int j = 1; j < columns_; ++j) {
      const double value = row[j] - potential_[at(j)];
      if (value < least || (value == least && demand_left_[at(best)] == 0)) least = value, best = j;
    }
    const std::int64_t units = std::min(supply_left_[at(i)], demand_left_[at(best)]);
    if (units > 0) {
      add_flow(i, best, units);
      supply_left_[at(i)] -= units;
      demand_left_[at(best)] -= units;
    }
  }
}

// Dijkstra over columns with reduced costs. A settled column leaves the search by an open distance of infinity and an
// open potential of minus infinity, which keeps the inner loop free of branches.
void ShortestPathTransport::augment(const RowMatrix& cost, int source) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  open_potential_ = potential_;
  std::fill(visited_.begin(), visited_.end(), char{0});
  settled_.clear();
  std::fill(open_distance_.begin(), open_distance_.end(), kInfinity);
  double nearest = visit(cost, source, 0.0);
  while (true) {
    int column = -1;
    for (int j = 0; j < columns_; ++j) {
      if (open_distance_[at(j)] != nearest) continue;
      column = j;
      if (demand_left_[at(j)] > 0) break;
    }
    if (demand_left_[at(column)] > 0) {
      // While no flow on the way runs dry the tree of paths stays as it is, and the rest of the supply may go on.
      const bool whole = push_along_path(source, column);
      if (supply_left_[at(source)] == 0 || !whole) break;
    }
    settled_.push_back({column, nearest});
    open_distance_[at(column)] = kInfinity;
    open_potential_[at(column)] = -kInfinity;
    double next = kInfinity;
    bool offered = false;
    for (const Flow& flow : flows_[at(column)]) {
      if (visited_[at(flow.row)]) continue;
      reached_from_[at(flow.row)] = column;
      next = visit(cost, flow.row, cost(flow.row, column) - potential_[at(column)] - nearest);
      offered = true;
    }
    nearest = offered ? next : kernels::least(open_distance_.data(), columns_);
  }
  for (const Settled& settled : settled_) potential_[at(settled.column)] += settled.distance - nearest;
}

// Offers the columns a path through `row`. @return the least distance of an open column
double ShortestPathTransport::visit(const RowMatrix& cost, int row, double offset) {
  visited_[at(row)] = 1;
  return kernels::relax(cost.row(row).data(), open_potential_.data(), offset, static_cast<double>(row),
                        open_distance_.data(), previous_row_.data(), columns_);
}

// Moves as much as source, sink and the flows between allow. @return whether all of these flows stay positive
bool ShortestPathTransport::push_along_path(int source, int sink) {
  const std::int64_t wanted = std::min(supply_left_[at(source)], demand_left_[at(sink)]);
  std::int64_t least = std::numeric_limits<std::int64_t>::max();
  for (int row = previous_row(sink); row != source;) {
    const int column = reached_from_[at(row)];
    for (const Flow& flow : flows_[at(column)]) {
      if (flow.row == row) least = std::min(least, flow.units);
    }
    row = previous_row(column);
  }
  const std::int64_t units = std::min(wanted, least);
  for (int column = sink;;) {
    const int row = previous_row(column);
    add_flow(row, column, units);
    if (row == source) break;
    column = reached_from_[at(row)];
    add_flow(row, column, -units);
  }
  supply_left_[at(source)] -= units;
  demand_left_[at(sink)] -= units;
  return units < least;
}

void ShortestPathTransport::add_flow(int row, int column, std::int64_t units) {
  std::vector<Flow>& flows = flows_[at(column)];
  for (std::size_t k = 0; k < flows.size(); ++k) {
    if (flows[k].row != row) continue;
    flows[k].units += units;
    if (flows[k].units == 0) flows.erase(flows.begin() + static_cast<std::ptrdiff_t>(k));
    return;
  }
  flows.push_back({row, units});
}

Eigen::MatrixXd squared_distances(const std::vector<Eigen::Vector3d>& x, const std::vector<Eigen::Vector3d>& y) {
  return matrix_of(x.size(), y.size(), [&](std::size_t i, std::size_t k) { return (x[i] - y[k]).squaredNorm(); });
}

JointTransport wasserstein2(const std::vector<Eigen::Vector3d>& x, const std::vector<Eigen::Vector3d>& y,
                            ExactSolver solver) {
  TransportPlan best =
      exact_transport(squared_distances(x, y), uniform_masses(x.size()), uniform_masses(y.size()), solver);
  return {std::sqrt(std::max(best.cost, 0.0)), std::move(best.plan)};
}

JointTransport wasserstein1(const std::vector<Eigen::Vector3d>& x, const std::vector<Eigen::Vector3d>& y,
                            ExactSolver solver) {
  TransportPlan best =
      exact_transport(squared_distances(x, y).cwiseSqrt(), uniform_masses(x.size()), uniform_masses(y.size()), solver);
  return {std::max(best.cost, 0.0), std::move(best.plan)};
}

SinkhornResult sinkhorn_wasserstein2(const std::vector<Eigen::Vector3d>& x, const std::vector<Eigen::Vector3d>& y,
                                     const SinkhornOptions& options) {
  return sinkhorn(squared_distances(x, y), uniform_masses(x.size()), uniform_masses(y.size()), options);
}

TransportSolver::TransportSolver(const MassUnits& units)
    : units_(units), simplex_(suits_simplex(units)), paths_(units) {}

const std::vector<PlanCell>& TransportSolver::solve(const RowMatrix& cost) {
  if (!simplex_) {
    const std::vector<PlanCell>& cells = paths_.solve(cost);
    lower_bound_ = paths_.dual_value();
    return cells;
  }
  double rounding = 0.0;
  cells_ = network_simplex_cells(cost, units_, rounding);
  lower_bound_ = -rounding;
  for (const PlanCell& cell : cells_) lower_bound_ += cell.mass * cost(cell.row, cell.column);
  return cells_;
}

}  // namespace anigen::metrics
