#include "anigen/metrics/gw_starts.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include "anigen/core/numeric.h"
#include "anigen/metrics/wasserstein.h"

namespace anigen::metrics {

namespace {

Eigen::VectorXd masses(const std::vector<std::int64_t>& units) {
  Eigen::VectorXd result(static_cast<Eigen::Index>(units.size()));
  for (std::size_t i = 0; i < units.size(); ++i) result[static_cast<Eigen::Index>(i)] = static_cast<double>(units[i]);
  return result;
}

// Distance to one end of the longest path minus distance to the other.
Eigen::VectorXd along_diameter(const RowMatrix& c) {
  Eigen::Index one = 0, two = 0;
  c.maxCoeff(&one, &two);
  return c.col(one) - c.col(two);
}

constexpr int kPowerSteps = 60;
constexpr std::int64_t kTurnsTried = 48;        // at least, of either sense
constexpr std::int64_t kTurnPairs = 1 << 22;    // and more as long as they have no more pairs of cells together
constexpr std::int64_t kWindowPairs = 1 << 25;  // likewise, around a coarse turn
constexpr std::size_t kCyclicStarts = 4;

// Points in the order of their angles in the plane of the two largest eigenvectors of −J D² J, J the centring.
std::vector<int> by_angle(const RowMatrix& distances) {
  RowMatrix centred = -distances.cwiseAbs2();
  const Eigen::VectorXd means = centred.rowwise().mean();
  const double mean = means.mean();
  centred.colwise() -= means;
  centred.rowwise() -= means.transpose();
  centred.array() += mean;
  Eigen::MatrixXd plane(distances.rows(), 2);
  for (Eigen::Index i = 0; i < plane.rows(); ++i) {
    const double x = static_cast<double>(i);
    plane.row(i) << std::sin(1.0 + 0.7 * x), std::cos(2.0 + 1.3 * x);
  }
  for (int step = 0; step < kPowerSteps; ++step) {
    plane = centred * plane;
    for (Eigen::Index k = 0; k < 2; ++k) {
      if (k == 1) plane.col(1) -= plane.col(0).dot(plane.col(1)) * plane.col(0);
      const double length = plane.col(k).norm();
      if (length > 0.0) plane.col(k) /= length;
    }
  }
  Eigen::VectorXd angles(plane.rows());
  for (Eigen::Index i = 0; i < plane.rows(); ++i) angles[i] = std::atan2(plane(i, 1), plane(i, 0));
  return ascending(angles);
}

/// A coupling of two cyclic orders.
struct Turn {
  double cost = 0.0;
  std::int64_t turn = 0;  ///< of the columns, in units of mass
  bool reversed = false;
};

// The monotone coupling that begins `turn` units into the columns' order; sorted by row and column.
std::vector<PlanCell> turned_coupling(const MassUnits& units, const std::vector<int>& rows,
                                      const std::vector<int>& columns, std::int64_t turn) {
  std::size_t k = 0;
  while (turn >= units.demands[at(columns[k])]) turn -= units.demands[at(columns[k++])];
  std::int64_t offered = units.demands[at(columns[k])] - turn;
  std::vector<PlanCell> cells;
  for (const int row : rows) {
    for (std::int64_t wanted = units.supplies[at(row)]; wanted > 0;) {
      const std::int64_t mass = std::min(wanted, offered);
      if (mass > 0) cells.push_back({row, columns[k], static_cast<double>(mass)});
      wanted -= mass;
      offered -= mass;
      if (offered > 0) continue;
      k = (k + 1) % columns.size();
      offered = units.demands[at(columns[k])];
    }
  }
  std::sort(cells.begin(), cells.end());
  // The first column's two parts may meet in one row.
  std::vector<PlanCell> merged;
  for (const PlanCell& cell : cells) {
    if (!merged.empty() && merged.back().row == cell.row && merged.back().column == cell.column)
      merged.back().mass += cell.mass;
    else
      merged.push_back(cell);
  }
  return merged;
}

// −κ <C1 X C2, X> of a coupling of few cells.
double bilinear(const GwProblem& problem, const std::vector<PlanCell>& cells) {
  double sum = 0.0;
  for (std::size_t e = 0; e < cells.size(); ++e) {
    const double* d1 = problem.c1.row(cells[e].row).data();
    const double* d2 = problem.c2.row(cells[e].column).data();
    double inner = 0.0;
    for (std::size_t f = 0; f < e; ++f) inner += cells[f].mass * d1[cells[f].row] * d2[cells[f].column];
    sum += 2.0 * cells[e].mass * inner;
  }
  return -problem.curvature * sum;
}

}  // namespace

std::vector<GwSparseStart> sorted_starts(const GwProblem& problem) {
  const MassUnits& units = problem.units;
  const auto monotone = [&](const Eigen::VectorXd& rows, const Eigen::VectorXd& columns) {
    return monotone_coupling(units, ascending(rows), ascending(columns));
  };
  const Eigen::VectorXd path1 = along_diameter(problem.c1), path2 = along_diameter(problem.c2);
  return {{"product", monotone(problem.c1 * masses(units.supplies), problem.c2 * masses(units.demands))},
          {"eccentricity", monotone(problem.c1.rowwise().maxCoeff(), problem.c2.rowwise().maxCoeff())},
          {"diameter", monotone(path1, path2)},
          {"diameter reversed", monotone(path1, -path2)}};
}

GwSparseStart profile_start(const GwProblem& problem, const RowMatrix& costs) {
  TransportSolver transport(problem.units);
  return {"profiles", transport.solve(costs)};
}

std::vector<GwSparseStart> cyclic_starts(const GwProblem& problem) {
  std::vector<GwSparseStart> starts;
  if (problem.rows() < 4 || problem.columns() < 4) return starts;
  const std::vector<int> rows = by_angle(problem.c1), columns = by_angle(problem.c2);
  const std::vector<int> backwards(columns.rbegin(), columns.rend());
  const std::int64_t total = problem.units.total, cells = problem.rows() + problem.columns();
  const std::int64_t stride = std::max<std::int64_t>(1, total / std::max(kTurnsTried, kTurnPairs / (cells * cells)));
  const auto coupling = [&](const Turn& turn) {
    return turned_coupling(problem.units, rows, turn.reversed ? backwards : columns, turn.turn);
  };
  const auto tried = [&](std::int64_t turn, bool reversed) {
    Turn result{0.0, ((turn % total) + total) % total, reversed};
    result.cost = bilinear(problem, coupling(result));
    return result;
  };
  const auto cheaper = [](const Turn& x, const Turn& y) { return x.cost < y.cost; };
  std::vector<Turn> valleys;
  for (const bool reversed : {false, true}) {
    std::vector<Turn> coarse;
    for (std::int64_t turn = 0; turn < total; turn += stride) coarse.push_back(tried(turn, reversed));
    for (std::size_t k = 0; k < coarse.size(); ++k) {
      const Turn &before = coarse[(k + coarse.size() - 1) % coarse.size()], &after = coarse[(k + 1) % coarse.size()];
      if (!cheaper(before, coarse[k]) && !cheaper(after, coarse[k])) valleys.push_back(coarse[k]);
    }
  }
  std::sort(valleys.begin(), valleys.end(), cheaper);
  valleys.resize(std::min(valleys.size(), kCyclicStarts));
  // The cost has a vertex at every unit, and the least of them is seldom the one that lies downhill: all are tried, or
  // of many points so many at a time, around the best of which those between follow.
  const std::int64_t most = std::max(kTurnsTried, kWindowPairs / (cells * cells));
  for (Turn& valley : valleys) {
    for (std::int64_t reach = stride; reach > 1;) {
      const Turn centre = valley;
      const std::int64_t step = (2 * reach + most - 1) / most;
      for (std::int64_t turn = -(reach - 1) / step * step; turn < reach; turn += step)
        valley = std::min(valley, tried(centre.turn + turn, centre.reversed), cheaper);
      reach = step;
    }
  }
  std::sort(valleys.begin(), valleys.end(), cheaper);
  for (const Turn& valley : valleys) starts.push_back({"turn", coupling(valley)});
  return starts;
}

}  // namespace anigen::metrics
