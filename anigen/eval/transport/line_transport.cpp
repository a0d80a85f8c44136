#include "anigen/eval/transport/line_transport.h"

#include <algorithm>
#include <cstdint>
#include <numeric>

namespace anigen::eval {

std::vector<int> ascending(const Eigen::VectorXd& values) {
  std::vector<int> order(static_cast<std::size_t>(values.size()));
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(), [&](int x, int y) { return values[x] < values[y]; });
  return order;
}

Eigen::VectorXd picked(const Eigen::VectorXd& values, const std::vector<int>& order) {
  Eigen::VectorXd result(values.size());
  for (Eigen::Index k = 0; k < values.size(); ++k) result[k] = values[order[static_cast<std::size_t>(k)]];
  return result;
}

std::vector<PlanCell> monotone_coupling(const MassUnits& units, const std::vector<int>& row_order,
                                        const std::vector<int>& column_order) {
  std::vector<PlanCell> cells;
  std::size_t i = 0, k = 0;
  std::int64_t supply = 0, demand = 0;
  while (true) {
    while (supply == 0 && i < row_order.size()) supply = units.supplies[static_cast<std::size_t>(row_order[i++])];
    while (demand == 0 && k < column_order.size()) demand = units.demands[static_cast<std::size_t>(column_order[k++])];
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

}  // namespace anigen::eval
