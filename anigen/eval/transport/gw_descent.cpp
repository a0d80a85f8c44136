#include "anigen/eval/transport/gw_descent.h"

#include <algorithm>

#include "anigen/core/numeric.h"
#include "anigen/eval/transport/row_kernels.h"

namespace anigen::eval {
namespace {

constexpr int kConditionalGradientSteps = 100;
constexpr int kSweeps = 200;
constexpr int kTurns = 20;

double inner(const RowMatrix& matrix, const std::vector<PlanCell>& cells) {
  double sum = 0.0;
  for (const PlanCell& cell : cells) sum += cell.mass * matrix(cell.row, cell.column);
  return sum;
}

// (1 - t) x + t y; both sorted by row and column.
std::vector<PlanCell> mixed(const std::vector<PlanCell>& x, const std::vector<PlanCell>& y, double t) {
  std::vector<PlanCell> result;
  std::size_t i = 0, k = 0;
  const auto before = [](const PlanCell& u, const PlanCell& v) {
    return u.row != v.row ? u.row < v.row : u.column < v.column;
  };
  while (i < x.size() || k < y.size()) {
    if (k == y.size() || (i < x.size() && before(x[i], y[k]))) {
      result.push_back({x[i].row, x[i].column, (1.0 - t) * x[i].mass});
      ++i;
    } else if (i == x.size() || before(y[k], x[i])) {
      result.push_back({y[k].row, y[k].column, t * y[k].mass});
      ++k;
    } else {
      result.push_back({x[i].row, x[i].column, (1.0 - t) * x[i].mass + t * y[k].mass});
      ++i, ++k;
    }
  }
  return result;
}

void sort_cells(std::vector<PlanCell>& cells) {
  std::sort(cells.begin(), cells.end(),
            [](const PlanCell& x, const PlanCell& y) { return x.row != y.row ? x.row < y.row : x.column < y.column; });
}

}  // namespace

GwDescent::GwDescent(const GwProblem& problem)
    : problem_(problem),
      resolution_(problem.resolution()),
      linear_program_(problem.units),
      index_(at(problem.rows()) * at(problem.columns()), -1),
      waiting_(at(problem.rows()), 0),
      step_(at(problem.columns())) {}

GwPoint GwDescent::from(const std::vector<PlanCell>& start) {
  std::vector<PlanCell> cells = start;
  for (int turn = 0; turn < kTurns; ++turn) {
    const int steps = conditional_gradient(cells, kConditionalGradientSteps);
    if (turn > 0 && steps == 0) break;
    set(cells, problem_.gradient(cells));
    bool exchanged = false;
    do {
      std::fill(waiting_.begin(), waiting_.end(), char{1});
    } while (exchange_waiting_rows() && (exchanged = true));
    cells = cells_;
    sort_cells(cells);
    if (!exchanged) break;
  }
  set(cells, problem_.gradient(cells));
  return current();
}

double GwDescent::perturb(const GwPoint& start, int exchanges, Rng& rng) {
  set(start.cells, start.gradient);
  std::fill(waiting_.begin(), waiting_.end(), char{0});
  for (int k = 0; k < exchanges; ++k) {
    const std::size_t e = rng.index(cells_.size()), f = rng.index(cells_.size());
    if (cells_[e].row != cells_[f].row && cells_[e].column != cells_[f].column) exchange(e, f);
  }
  exchange_waiting_rows();
  return problem_.objective(cells_, gradient_);
}

int GwDescent::conditional_gradient(std::vector<PlanCell>& cells, int max_iterations) {
  RowMatrix gradient = problem_.gradient(cells);
  int iteration = 0;
  for (; iteration < max_iterations; ++iteration) {
    const std::vector<PlanCell>& vertex = linear_program_.solve(gradient);
    const double slope = inner(gradient, vertex) - inner(gradient, cells);
    if (slope >= -resolution_) break;
    RowMatrix next = problem_.gradient(vertex);
    const double curve = 0.5 * (inner(next, vertex) - inner(next, cells) - slope);
    // Concave along the way, as for every pair of tree metrics: the whole step.
    const double t = curve <= 0.0 ? 1.0 : std::min(1.0, -slope / (2.0 * curve));
    if (t == 1.0) {
      cells = vertex;
      gradient = std::move(next);
    } else {
      cells = mixed(cells, vertex, t);
      gradient = (1.0 - t) * gradient + t * next;  // affine in the coupling
    }
  }
  return iteration;
}

void GwDescent::set(const std::vector<PlanCell>& cells, const RowMatrix& gradient) {
  for (const PlanCell& cell : cells_) index_[at(cell.row) * at(problem_.columns()) + at(cell.column)] = -1;
  cells_ = cells;
  for (std::size_t e = 0; e < cells_.size(); ++e)
    index_[at(cells_[e].row) * at(problem_.columns()) + at(cells_[e].column)] = static_cast<int>(e);
  gradient_ = gradient;
}

// Rows wait to be looked at until an exchange touches them.
bool GwDescent::exchange_waiting_rows() {
  bool improved = false;
  if (!problem_.sparse(cells_.size())) return improved;  // stopped inside the polytope: not a tree metric
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    bool waiting = false;
    for (int row = 0; row < problem_.rows(); ++row) {
      if (!waiting_[at(row)]) continue;
      waiting_[at(row)] = 0;
      for (std::size_t e = 0; e < cells_.size(); ++e) {
        if (cells_[e].row == row && exchange_with_best_partner(e)) waiting = true;
      }
    }
    if (!waiting) break;
    improved = true;
  }
  return improved;
}

bool GwDescent::exchange_with_best_partner(std::size_t e) {
  const PlanCell x = cells_[e];
  const std::ptrdiff_t columns = problem_.columns();
  const double* gradient = gradient_.data();
  const double* own_row = gradient + x.row * columns;
  const double* distances1 = problem_.c1.row(x.row).data();
  const double* distances2 = problem_.c2.row(x.column).data();
  const double own = own_row[x.column], bend = 4.0 * problem_.curvature;
  double best = -resolution_;
  std::size_t partner = e;
  for (std::size_t f = 0; f < cells_.size(); ++f) {
    const PlanCell& y = cells_[f];
    const double* other = gradient + y.row * columns;
    const double mass = std::min(x.mass, y.mass);
    const double slope = own_row[y.column] + other[x.column] - own - other[y.column];
    const double change = mass * (slope - bend * mass * distances1[y.row] * distances2[y.column]);
    if (change < best) best = change, partner = f;
  }
  // In one row or column an exchange changes nothing; what looks like a gain there is rounding.
  if (partner == e || x.row == cells_[partner].row || x.column == cells_[partner].column) return false;
  exchange(e, partner);
  return true;
}

void GwDescent::exchange(std::size_t e, std::size_t f) {
  const PlanCell x = cells_[e], y = cells_[f];
  const double mass = std::min(x.mass, y.mass);
  waiting_[at(x.row)] = waiting_[at(y.row)] = 1;
  add(x.row, y.column, mass);
  add(y.row, x.column, mass);
  add(x.row, x.column, -mass);
  add(y.row, y.column, -mass);
  const double* to = problem_.c2.row(y.column).data();
  const double* away = problem_.c2.row(x.column).data();
  const double factor = -2.0 * problem_.curvature * mass;
  const int columns = problem_.columns();
  for (int k = 0; k < columns; ++k) step_[at(k)] = factor * (to[k] - away[k]);
  const double* from_row = problem_.c1.row(x.row).data();
  const double* from_other = problem_.c1.row(y.row).data();
  for (int i = 0; i < problem_.rows(); ++i) {
    const double lever = from_row[i] - from_other[i];
    kernels::add_scaled(lever, step_.data(), gradient_.row(i).data(), columns);
  }
}

void GwDescent::add(int row, int column, double mass) {
  const std::size_t place = at(row) * at(problem_.columns()) + at(column);
  if (index_[place] < 0) {
    index_[place] = static_cast<int>(cells_.size());
    cells_.push_back({row, column, 0.0});
  }
  const std::size_t e = at(index_[place]);
  cells_[e].mass += mass;
  if (cells_[e].mass > 0.0) return;
  // Emptied: the last cell takes its place.
  index_[place] = -1;
  if (e + 1 < cells_.size()) {
    cells_[e] = cells_.back();
    index_[at(cells_[e].row) * at(problem_.columns()) + at(cells_[e].column)] = static_cast<int>(e);
  }
  cells_.pop_back();
}

}  // namespace anigen::eval
