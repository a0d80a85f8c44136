#include "anigen/eval/transport/shortest_path_transport.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "anigen/core/numeric.h"
#include "anigen/eval/transport/row_kernels.h"

namespace anigen::eval {

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
  std::sort(cells_.begin(), cells_.end(),
            [](const PlanCell& x, const PlanCell& y) { return x.row != y.row ? x.row < y.row : x.column < y.column; });
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

double ShortestPathTransport::dual_value() const { return dual_; }

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

}  // namespace anigen::eval
