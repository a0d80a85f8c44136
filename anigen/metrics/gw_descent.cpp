#include "anigen/metrics/gw_descent.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "anigen/core/numeric.h"

namespace anigen::metrics {

namespace {

constexpr int kConditionalGradientSteps = 100;
constexpr int kSweeps = 200;
constexpr int kTurns = 20;
constexpr std::size_t kNear = 8;   // points among which a near exchange finds its partner
constexpr double kLikeSize = 0.7;  // branches of like size
constexpr int kSwapsDrawn = 4;     // of which the least costly is tried

double inner(const RowMatrix& matrix, const std::vector<PlanCell>& cells) {
  double sum = 0.0;
  for (const PlanCell& cell : cells) sum += cell.mass * matrix(cell.row, cell.column);
  return sum;
}

// (1 - t) x + t y; both sorted by row and column.
std::vector<PlanCell> mixed(const std::vector<PlanCell>& x, const std::vector<PlanCell>& y, double t) {
  std::vector<PlanCell> result;
  std::size_t i = 0, k = 0;
  while (i < x.size() || k < y.size()) {
    if (k == y.size() || (i < x.size() && x[i] < y[k])) {
      result.push_back({x[i].row, x[i].column, (1.0 - t) * x[i].mass});
      ++i;
    } else if (i == x.size() || y[k] < x[i]) {
      result.push_back({y[k].row, y[k].column, t * y[k].mass});
      ++k;
    } else {
      result.push_back({x[i].row, x[i].column, (1.0 - t) * x[i].mass + t * y[k].mass});
      ++i, ++k;
    }
  }
  return result;
}

// Joints of the branch that begins at each joint of a tree in preorder.
std::vector<int> branch_sizes(const MetricTree& tree) {
  std::vector<int> sizes(tree.parents.size(), 1);
  for (std::size_t k = sizes.size(); k-- > 1;) sizes[at(tree.parents[k])] += sizes[k];
  return sizes;
}

}  // namespace

GwDescent::GwDescent(const GwProblem& problem)
    : problem_(problem),
      resolution_(problem.resolution()),
      linear_program_(problem.units),
      index_(at(problem.rows()) * at(problem.columns()), -1),
      waiting_(at(problem.rows()), 0),
      lever_(at(problem.rows())),
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
    std::sort(cells.begin(), cells.end());
    if (!exchanged) break;
  }
  set(cells, problem_.gradient(cells));
  return current();
}

double GwDescent::perturb(const GwPoint& start, int exchanges, Rng& rng) {
  set(start.cells, start.gradient);
  std::fill(waiting_.begin(), waiting_.end(), char{0});
  const bool near = rng.chance(0.5);
  for (int k = 0; k < exchanges; ++k) {
    const std::size_t e = rng.index(cells_.size());
    const std::size_t f = near ? near_cell(e, rng) : rng.index(cells_.size());
    if (cells_[e].row != cells_[f].row && cells_[e].column != cells_[f].column) exchange(e, f);
  }
  exchange_waiting_rows();
  return problem_.objective(cells_, gradient_);
}

// A cell in a row or, by half, a column among the nearest to those of another cell.
std::size_t GwDescent::near_cell(std::size_t e, Rng& rng) {
  const bool rows = rng.chance(0.5);
  const std::vector<int>& nearest = by_distance(rows, at(rows ? cells_[e].row : cells_[e].column));
  const int wanted = nearest[rng.index(std::min(nearest.size(), kNear))];
  const std::size_t first = rng.index(cells_.size());
  for (std::size_t k = 0; k < cells_.size(); ++k) {
    const std::size_t f = (first + k) % cells_.size();
    if ((rows ? cells_[f].row : cells_[f].column) == wanted) return f;
  }
  return e;
}

double GwDescent::perturb_neighbourhoods(const GwPoint& start, Rng& rng) {
  const bool rows = rng.chance(0.5), turned = rng.chance(0.25);
  const std::size_t points = at(rows ? problem_.rows() : problem_.columns());
  if (points < 4) return start.objective;
  const std::size_t most = points / 2;
  // Small ones more often: sizes even in their logarithm.
  const std::size_t size =
      std::min(most, static_cast<std::size_t>(2.0 * std::pow(static_cast<double>(most) / 2.0, rng.uniform()) + 0.5));
  return after_best_swap(start, [&] {
    const std::size_t one = rng.index(points), other = rng.index(points);
    return turned || one == other ? turned_neighbourhood(rows, one, size) : two_neighbourhoods(rows, one, other, size);
  });
}

// One neighbourhood, sorted by the distance to its first less that to its farthest point, then back to front.
GwDescent::PartnerSwap GwDescent::turned_neighbourhood(bool rows, std::size_t centre, std::size_t size) {
  const std::vector<int>& nearest = by_distance(rows, centre);
  PartnerSwap swap{rows, {nearest.begin(), nearest.begin() + static_cast<std::ptrdiff_t>(size)}, {}};
  const RowMatrix& distances = rows ? problem_.c1 : problem_.c2;
  const int last = swap.from.back();
  int first = last;
  for (const int point : swap.from)
    if (distances(last, point) > distances(last, first)) first = point;
  std::sort(swap.from.begin(), swap.from.end(), [&](int x, int y) {
    return distances(first, x) - distances(last, x) < distances(first, y) - distances(last, y);
  });
  swap.to.assign(swap.from.rbegin(), swap.from.rend());
  return swap;
}

// Two neighbourhoods that share no point, paired from their centres outwards.
GwDescent::PartnerSwap GwDescent::two_neighbourhoods(bool rows, std::size_t one, std::size_t other, std::size_t size) {
  const std::vector<int>& mine = by_distance(rows, one);
  const std::vector<int>& theirs = by_distance(rows, other);
  PartnerSwap swap{rows, {}, {}};
  std::vector<char> taken(mine.size(), 0);
  for (std::size_t i = 0, k = 0; swap.from.size() < 2 * size && i < mine.size() && k < mine.size();) {
    while (i < mine.size() && taken[at(mine[i])]) ++i;
    if (i == mine.size()) break;
    taken[at(mine[i])] = 1;
    while (k < mine.size() && taken[at(theirs[k])]) ++k;
    if (k == mine.size()) break;
    taken[at(theirs[k])] = 1;
    swap.add(mine[i], theirs[k]);
  }
  return swap;
}

double GwDescent::perturb_branches(const GwPoint& start, Rng& rng) {
  const bool rows = rng.chance(0.5);
  std::vector<int>& sizes = rows ? branch_rows_ : branch_columns_;
  if (sizes.empty()) sizes = branch_sizes(rows ? *problem_.tree1 : *problem_.tree2);
  const int joints = static_cast<int>(sizes.size());
  if (joints < 3) return start.objective;
  const int one = 1 + static_cast<int>(rng.index(at(joints - 1)));
  const auto apart = [&](int other) { return other >= one + sizes[at(one)] || one >= other + sizes[at(other)]; };
  std::vector<int> others;
  for (int other = 1; other < joints; ++other) {
    const int less = std::min(sizes[at(one)], sizes[at(other)]), more = std::max(sizes[at(one)], sizes[at(other)]);
    if (other != one && apart(other) && less >= kLikeSize * more) others.push_back(other);
  }
  if (others.empty()) return start.objective;
  return after_best_swap(start, [&] {
    const int other = others[rng.index(others.size())];
    PartnerSwap swap{rows, {}, {}};
    for (int k = 0; k < std::min(sizes[at(one)], sizes[at(other)]); ++k) swap.add(one + k, other + k);
    return swap;
  });
}

// Draws some swaps, makes the one that costs least, and descends. A swap that changes nothing is a symmetry's.
double GwDescent::after_best_swap(const GwPoint& start, const std::function<PartnerSwap()>& drawn) {
  set(start.cells, start.gradient);
  std::fill(waiting_.begin(), waiting_.end(), char{0});
  PartnerSwap best;
  double least = std::numeric_limits<double>::infinity();
  for (int k = 0; k < kSwapsDrawn; ++k) {
    PartnerSwap swap = drawn();
    const double change = change_by(swap);
    if (std::abs(change) <= resolution_ || change >= least) continue;
    least = change;
    best = std::move(swap);
  }
  if (best.from.empty()) return start.objective;
  if (best.rows)
    move_rows(best.from, best.to);
  else
    move_columns(best.from, best.to);
  exchange_waiting_rows();
  return problem_.objective(cells_, gradient_);
}

// f(X + ΔX) − f(X) = <G, ΔX> − κ <C1 ΔX C2, ΔX>, where ΔX takes the mass of each moved cell from one row to another.
double GwDescent::change_by(const PartnerSwap& swap) {
  const RowMatrix& c1 = swap.rows ? problem_.c1 : problem_.c2;
  const RowMatrix& c2 = swap.rows ? problem_.c2 : problem_.c1;
  goes_.assign(at(static_cast<int>(c1.rows())), -1);
  for (std::size_t k = 0; k < swap.from.size(); ++k) goes_[at(swap.from[k])] = swap.to[k];
  struct Move {
    int from, to, partner;
    double mass;
  };
  std::vector<Move> moves;
  double linear = 0.0, quadratic = 0.0;
  for (const PlanCell& cell : cells_) {
    const int from = swap.rows ? cell.row : cell.column, partner = swap.rows ? cell.column : cell.row;
    const int to = goes_[at(from)];
    if (to < 0 || to == from) continue;
    moves.push_back({from, to, partner, cell.mass});
    linear += cell.mass * (swap.rows ? gradient_(to, partner) - gradient_(from, partner)
                                     : gradient_(partner, to) - gradient_(partner, from));
  }
  for (std::size_t e = 0; e < moves.size(); ++e) {
    const Move& x = moves[e];
    const double* to = c1.row(x.to).data();
    const double* from = c1.row(x.from).data();
    const double* partners = c2.row(x.partner).data();
    double sum = 0.0;  // pairs count twice; a cell with itself gives nothing, since its partner is at no distance
    for (std::size_t f = 0; f < e; ++f) {
      const Move& y = moves[f];
      sum += y.mass * partners[y.partner] * (to[y.to] - to[y.from] - from[y.to] + from[y.from]);
    }
    quadratic += 2.0 * x.mass * sum;
  }
  return linear - problem_.curvature * quadratic;
}

int GwDescent::conditional_gradient(std::vector<PlanCell>& cells, int max_iterations) {
  // Frank–Wolfe on f(X) = <M, X> − κ <C1 X C2, X>, κ the curvature, with G = ∇f(X) = M − 2 κ C1 X C2.
  RowMatrix gradient = problem_.gradient(cells);
  int iteration = 0;
  for (; iteration < max_iterations; ++iteration) {
    // Y = argmin <G, Y> over couplings; <G, X − Y> is the duality gap.
    const std::vector<PlanCell>& vertex = linear_program_.solve(gradient);
    const double slope = inner(gradient, vertex) - inner(gradient, cells);
    if (slope >= -resolution_) break;
    RowMatrix next = problem_.gradient(vertex);
    const double curve = 0.5 * (inner(next, vertex) - inner(next, cells) - slope);
    // f(X + t (Y − X)) = f(X) + t slope + t² curve, least at t = −slope / (2 curve); where it is concave, as for
    // every pair of tree metrics, at the whole step.
    const double t = curve <= 0.0 ? 1.0 : std::min(1.0, -slope / (2.0 * curve));
    if (t == 1.0) {
      cells = vertex;
      gradient = std::move(next);
    } else {
      cells = mixed(cells, vertex, t);
      gradient = (1.0 - t) * gradient + t * next;  // G is affine in X
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
    // δ <D, E> − 4 κ δ² C1_ij C2_pq, as above.
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
  for (int i = 0; i < problem_.rows(); ++i) lever_[at(i)] = from_row[i] - from_other[i];
  kernels::add_outer(lever_.data(), step_.data(), gradient_.data(), problem_.rows(), columns);
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

// Moves the cells of row from[k] into row to[k]: X changes by ΔX in these rows alone, and G by −2 κ C1 ΔX C2.
void GwDescent::move_rows(const std::vector<int>& from, const std::vector<int>& to) {
  std::vector<int> place(at(problem_.rows()), -1), target(at(problem_.rows()));
  for (std::size_t k = 0; k < from.size(); ++k) place[at(from[k])] = static_cast<int>(k), target[at(from[k])] = to[k];
  const Eigen::Index moved = static_cast<Eigen::Index>(from.size());
  RowMatrix change = RowMatrix::Zero(moved, problem_.columns()), lever(problem_.rows(), moved);  // ΔX C2; C1
  for (std::size_t k = 0; k < from.size(); ++k) lever.col(static_cast<Eigen::Index>(k)) = problem_.c1.col(from[k]);
  std::vector<PlanCell> cells = cells_;
  for (PlanCell& cell : cells) {
    if (place[at(cell.row)] < 0) continue;
    const int goes = target[at(cell.row)];
    change.row(place[at(cell.row)]) -= cell.mass * problem_.c2.row(cell.column);
    change.row(place[at(goes)]) += cell.mass * problem_.c2.row(cell.column);
    waiting_[at(goes)] = 1;
    cell.row = goes;
  }
  RowMatrix gradient = gradient_;
  gradient.noalias() -= 2.0 * problem_.curvature * lever * change;
  set(cells, gradient);
}

// Likewise of columns.
void GwDescent::move_columns(const std::vector<int>& from, const std::vector<int>& to) {
  std::vector<int> place(at(problem_.columns()), -1), target(at(problem_.columns()));
  for (std::size_t k = 0; k < from.size(); ++k) place[at(from[k])] = static_cast<int>(k), target[at(from[k])] = to[k];
  const Eigen::Index moved = static_cast<Eigen::Index>(from.size());
  RowMatrix change = RowMatrix::Zero(problem_.rows(), moved), lever(moved, problem_.columns());  // C1 ΔX; C2
  for (std::size_t k = 0; k < from.size(); ++k) lever.row(static_cast<Eigen::Index>(k)) = problem_.c2.row(from[k]);
  std::vector<PlanCell> cells = cells_;
  for (PlanCell& cell : cells) {
    if (place[at(cell.column)] < 0) continue;
    const int goes = target[at(cell.column)];
    change.col(place[at(cell.column)]) -= cell.mass * problem_.c1.col(cell.row);
    change.col(place[at(goes)]) += cell.mass * problem_.c1.col(cell.row);
    waiting_[at(cell.row)] = 1;
    cell.column = goes;
  }
  RowMatrix gradient = gradient_;
  gradient.noalias() -= 2.0 * problem_.curvature * change * lever;
  set(cells, gradient);
}

const std::vector<int>& GwDescent::by_distance(bool rows, std::size_t point) {
  std::vector<std::vector<int>>& lists = rows ? nearest_rows_ : nearest_columns_;
  const RowMatrix& distances = rows ? problem_.c1 : problem_.c2;
  lists.resize(static_cast<std::size_t>(distances.rows()));
  std::vector<int>& list = lists[point];
  if (list.empty()) {
    list = ascending(distances.row(static_cast<Eigen::Index>(point)).transpose());
    // Points at no distance may come before the point itself.
    std::iter_swap(list.begin(), std::find(list.begin(), list.end(), static_cast<int>(point)));
  }
  return list;
}

}  // namespace anigen::metrics
