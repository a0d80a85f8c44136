#include "anigen/metrics/gromov_wasserstein.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"
#include "anigen/metrics/gw_problem.h"
#include "anigen/metrics/sinkhorn.h"
#include "anigen/metrics/transport_plan.h"
#include "anigen/metrics/wasserstein.h"

namespace anigen::metrics {

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

/// A local minimum of a GwProblem.
struct GwPoint {
  std::vector<PlanCell> cells;  ///< masses in units
  double objective = 0.0;
  RowMatrix gradient;  ///< there
};

/// Local search on a GwProblem: conditional gradient with exact line search (a transport problem per step), then
/// exchanges of mass between two cells, (i,p), (j,q) -> (i,q), (j,p), in turns until neither improves.
///
/// An exchange is judged in constant time from the gradient D: with E = (e_i - e_j)(e_q - e_p)^T and delta units
/// moved, the objective changes by delta <D, E> - 4 curvature delta^2 C1_ij C2_pq, and D by the rank-one matrix
/// -2 curvature delta (C1_i - C1_j)(C2_q - C2_p)^T.
class GwDescent {
 public:
  explicit GwDescent(const GwProblem& problem)
      : problem_(problem),
        resolution_(problem.resolution()),
        linear_program_(problem.units),
        index_(at(problem.rows()) * at(problem.columns()), -1),
        waiting_(at(problem.rows()), 0),
        step_(at(problem.columns())) {}

  /// Descends from a coupling. @param start masses in units, row and column sums those of the problem
  GwPoint from(const std::vector<PlanCell>& start) {
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
  /// Does `exchanges` random exchanges from a point, then descends by further exchanges of the rows they touched.
  /// @return the objective reached, at current()
  double perturb(const GwPoint& start, int exchanges, Rng& rng) {
    set(start.cells, start.gradient);
    std::fill(waiting_.begin(), waiting_.end(), char{0});
    for (int k = 0; k < exchanges; ++k) {
      const std::size_t e = rng.index(cells_.size()), f = rng.index(cells_.size());
      if (cells_[e].row != cells_[f].row && cells_[e].column != cells_[f].column) exchange(e, f);
    }
    exchange_waiting_rows();
    return problem_.objective(cells_, gradient_);
  }
  GwPoint current() const { return {cells_, problem_.objective(cells_, gradient_), gradient_}; }
  /// Conditional gradient alone. @return iterations done
  int conditional_gradient(std::vector<PlanCell>& cells, int max_iterations) {
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

 private:
  void set(const std::vector<PlanCell>& cells, const RowMatrix& gradient) {
    for (const PlanCell& cell : cells_) index_[at(cell.row) * at(problem_.columns()) + at(cell.column)] = -1;
    cells_ = cells;
    for (std::size_t e = 0; e < cells_.size(); ++e)
      index_[at(cells_[e].row) * at(problem_.columns()) + at(cells_[e].column)] = static_cast<int>(e);
    gradient_ = gradient;
  }
  bool exchange_waiting_rows() {
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
  bool exchange_with_best_partner(std::size_t e) {
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
  void exchange(std::size_t e, std::size_t f) {
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
  void add(int row, int column, double mass) {
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

  const GwProblem& problem_;
  double resolution_;
  TransportSolver linear_program_;
  std::vector<PlanCell> cells_;
  std::vector<int> index_;     // cell at (row, column), or -1
  std::vector<char> waiting_;  // rows whose cells may have found new partners
  RowMatrix gradient_;
  std::vector<double> step_;
};

/// The search that gromov_wasserstein and fused_gromov_wasserstein share: minimises
///   (1 - alpha) <features, plan> + alpha sum (d1 - d2)^2 plan plan.
struct GwSearch {
  const Eigen::MatrixXd &c1, &c2;
  const Eigen::VectorXd &a, &b;
  const Eigen::MatrixXd* features = nullptr;  ///< [n,m], or null for none
  double alpha = 1.0;
  const std::vector<GwStart>& starts;
  const GromovWassersteinOptions& options;

  GromovWasserstein run() const;
};

constexpr double kIsometric = 1e-14;  // of the largest squared distance: lengths equal to about 1e-7

void check_distances(const Eigen::MatrixXd& c, const std::string& name) {
  if (c.rows() == 0 || c.rows() != c.cols()) throw InputError("", name, "distances must be a square matrix");
  if (!c.allFinite()) throw InputError("", name, "a distance is not finite");
  const double tolerance = 1e-9 * c.cwiseAbs().maxCoeff();
  if (c.minCoeff() < 0.0) throw InputError("", name, "a distance is negative");
  if (c.diagonal().maxCoeff() > tolerance) throw InputError("", name, "a point has a distance to itself");
  if ((c - c.transpose()).cwiseAbs().maxCoeff() > tolerance)
    throw InputError("", name, "the distances are not symmetric");
}

// The problem in the numbering the search works in.
struct Numbered {
  GwProblem problem;
  std::vector<int> rows, columns;  // rows[k]: the caller's number of row k
  Eigen::MatrixXd c1, c2;
  Eigen::VectorXd a, b;
  RowMatrix features;
  bool isomorphic = false;
};

RowMatrix picked_block(const Eigen::MatrixXd& values, const std::vector<int>& rows, const std::vector<int>& columns) {
  return matrix_of(rows.size(), columns.size(),
                   [&](std::size_t i, std::size_t k) { return values(rows[i], columns[k]); });
}

Numbered numbered(const GwSearch& search) {
  Numbered result;
  std::optional<MetricTree> tree1 = metric_tree(search.c1), tree2 = metric_tree(search.c2);
  if (tree1 && tree2) {
    CanonicalOrder order = canonical_order({std::move(*tree1), search.a, {}}, {std::move(*tree2), search.b, {}});
    result.rows = std::move(order.first);
    result.columns = std::move(order.second);
    result.isomorphic = order.isomorphic;
    result.c1 = path_lengths(order.first_tree);
    result.c2 = path_lengths(order.second_tree);
    result.problem.tree1 = std::move(order.first_tree);
    result.problem.tree2 = std::move(order.second_tree);
  } else {
    result.rows.resize(static_cast<std::size_t>(search.c1.rows()));
    result.columns.resize(static_cast<std::size_t>(search.c2.rows()));
    std::iota(result.rows.begin(), result.rows.end(), 0);
    std::iota(result.columns.begin(), result.columns.end(), 0);
    result.c1 = search.c1;
    result.c2 = search.c2;
  }
  result.a = picked(search.a, result.rows);
  result.b = picked(search.b, result.columns);
  GwProblem& problem = result.problem;
  problem.c1 = result.c1;
  problem.c2 = result.c2;
  problem.units = mass_units(result.a, result.b);
  problem.curvature = 2.0 * search.alpha / static_cast<double>(problem.units.total);
  if (search.features != nullptr) {
    result.features = picked_block(*search.features, result.rows, result.columns);
    problem.linear = (1.0 - search.alpha) * result.features;
  }
  return result;
}

// Evaluates vertices directly, so that an isometry costs exactly nothing.
double true_cost(const Numbered& numbers, std::vector<PlanCell> cells, double alpha) {
  for (PlanCell& cell : cells) cell.mass /= static_cast<double>(numbers.problem.units.total);
  double cost = 0.0;
  if (numbers.problem.sparse(cells.size())) {
    cost = alpha * gw_cost(numbers.problem.c1, numbers.problem.c2, cells);
  } else {
    Eigen::MatrixXd plan = Eigen::MatrixXd::Zero(numbers.c1.rows(), numbers.c2.rows());
    for (const PlanCell& cell : cells) plan(cell.row, cell.column) = cell.mass;
    cost = alpha * gw_cost(numbers.c1, numbers.c2, plan);
  }
  if (numbers.features.size() == 0) return cost;
  for (const PlanCell& cell : cells) cost += (1.0 - alpha) * cell.mass * numbers.features(cell.row, cell.column);
  return cost;
}

std::vector<PlanCell> isomorphism(const Numbered& numbers) {
  std::vector<PlanCell> cells;
  for (int k = 0; k < numbers.problem.rows(); ++k)
    cells.push_back({k, k, static_cast<double>(numbers.problem.units.supplies[at(k)])});
  return cells;
}

std::vector<PlanCell> in_units(const Eigen::MatrixXd& plan, const Numbered& numbers) {
  const double total = static_cast<double>(numbers.problem.units.total);
  return plan_cells(picked_block(plan, numbers.rows, numbers.columns) * total);
}

// Proximal plan at a temperature where the coarse correspondence is decided; the descent settles the rest.
std::vector<PlanCell> entropic_start(const Numbered& numbers) {
  EntropicGwOptions options;
  options.solver = EntropicGwSolver::kProximalPoint;
  options.epsilon = 0.05;
  options.max_iterations = 60;
  options.sinkhorn_iterations = 100;
  const EntropicGw found = entropic_gromov_wasserstein(numbers.c1, numbers.c2, numbers.a, numbers.b, options);
  return plan_cells(round_to_coupling(found.plan, numbers.a, numbers.b) *
                    static_cast<double>(numbers.problem.units.total));
}

std::vector<GwSparseStart> all_starts(const GwSearch& search, const Numbered& numbers) {
  std::vector<GwSparseStart> starts;
  if (numbers.isomorphic) starts.push_back({"isomorphism", isomorphism(numbers)});
  for (const GwStart& start : search.starts) {
    if (start.plan.rows() != search.c1.rows() || start.plan.cols() != search.c2.rows())
      throw InputError("", "start " + start.name, "its plan has the wrong shape");
    starts.push_back({start.name, in_units(start.plan, numbers)});
  }
  for (GwSparseStart& start : sorted_starts(numbers.problem)) starts.push_back(std::move(start));
  starts.push_back(profile_start(numbers.problem, profile_costs(numbers.c1, numbers.c2, numbers.a, numbers.b)));
  if (search.options.entropic) starts.push_back({"entropic", entropic_start(numbers)});
  return starts;
}

constexpr int kLookEvery = 10;

// Plain (not logarithmic) Sinkhorn, as the published solver runs it.
Eigen::MatrixXd scaled_kernel(const Eigen::MatrixXd& cost, const Eigen::VectorXd& a, const Eigen::VectorXd& b,
                              const EntropicGwOptions& options) {
  const Eigen::MatrixXd kernel = (-cost / options.epsilon).array().exp();  // K = exp(−C / ε)
  Eigen::VectorXd u = uniform_masses(static_cast<std::size_t>(a.size()));
  Eigen::VectorXd v = uniform_masses(static_cast<std::size_t>(b.size()));
  for (int i = 0; i < options.sinkhorn_iterations; ++i) {
    const Eigen::VectorXd last_u = u, last_v = v, columns = kernel.transpose() * u;
    v = b.cwiseQuotient(columns);     // v = b / Kᵀu
    u = a.cwiseQuotient(kernel * v);  // u = a / K v
    if ((columns.array() == 0.0).any() || !u.allFinite() || !v.allFinite()) {
      u = last_u;
      v = last_v;
      break;
    }
    if (i % kLookEvery == 0 && (v.cwiseProduct(kernel.transpose() * u) - b).norm() < options.sinkhorn_tolerance) break;
  }
  return u.asDiagonal() * kernel * v.asDiagonal();
}

GromovWasserstein GwSearch::run() const {
  check_distances(c1, "first space");
  check_distances(c2, "second space");
  check_transport(Eigen::MatrixXd::Zero(c1.rows(), c2.rows()), a, b);
  if (std::abs(a.sum() - 1.0) > 1e-9) throw InputError("", "", "the masses must sum to 1");
  const Numbered numbers = numbered(*this);
  const GwProblem& problem = numbers.problem;

  GromovWasserstein result;
  GwPoint best;
  const double largest = std::max(c1.maxCoeff(), c2.maxCoeff());
  if (numbers.isomorphic && features == nullptr) {
    best.cells = isomorphism(numbers);
    const double cost = true_cost(numbers, best.cells, alpha);
    if (cost <= kIsometric * largest * largest) {
      result.start = "isomorphism";
      result.costs = {{result.start, cost}};
    }
  }
  if (result.start.empty()) {
    const double resolution = problem.resolution();
    GwDescent descent(problem);
    std::vector<double> seen;
    // A start's own cost tells well enough how good it is; the cheapest few descend.
    const std::vector<GwSparseStart> starts_to_try = all_starts(*this, numbers);
    std::vector<GwPoint> points;
    for (const GwSparseStart& start : starts_to_try)
      points.push_back({start.cells, problem.objective(start.cells), {}});
    std::vector<std::size_t> order(points.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    std::stable_sort(order.begin(), order.end(),
                     [&](std::size_t x, std::size_t y) { return points[x].objective < points[y].objective; });
    int descents = 0;
    for (const std::size_t k : order) {
      const bool repeated = std::any_of(seen.begin(), seen.end(),
                                        [&](double o) { return std::abs(o - points[k].objective) <= resolution; });
      seen.push_back(points[k].objective);
      if (repeated || descents == options.descents) continue;
      ++descents;
      points[k] = descent.from(points[k].cells);
      if (result.start.empty() || points[k].objective < best.objective - resolution) {
        best = points[k];
        result.start = starts_to_try[k].name;
      }
    }
    for (std::size_t k = 0; k < points.size(); ++k)
      result.costs.emplace_back(starts_to_try[k].name, true_cost(numbers, points[k].cells, alpha));
    Rng rng(options.seed, "gromov_wasserstein");
    bool exchanged = false;
    const double affordable =
        std::min(1.0, kFullSearchCells / static_cast<double>(problem.c1.rows() * problem.c2.rows()));
    const int rounds = static_cast<int>(std::ceil(options.perturbations * affordable));
    for (int round = 0; round < rounds; ++round) {
      if (descent.perturb(best, 2 + round % 4, rng) >= best.objective - resolution) continue;
      best = descent.current();
      exchanged = true;
    }
    if (exchanged) {
      best = descent.from(best.cells);
      result.start += " + exchanges";
    }
  }
  result.cost = true_cost(numbers, best.cells, alpha);
  result.value = std::sqrt(result.cost);
  result.plan.setZero(c1.rows(), c2.rows());
  for (const PlanCell& cell : best.cells) {
    result.plan(numbers.rows[at(cell.row)], numbers.columns[at(cell.column)]) +=
        cell.mass / static_cast<double>(problem.units.total);
  }
  return result;
}

}  // namespace

GromovWasserstein gromov_wasserstein(const Eigen::MatrixXd& c1, const Eigen::MatrixXd& c2, const Eigen::VectorXd& a,
                                     const Eigen::VectorXd& b, const std::vector<GwStart>& starts,
                                     const GromovWassersteinOptions& options) {
  return GwSearch{c1, c2, a, b, nullptr, 1.0, starts, options}.run();
}

GwConditionalGradient gw_conditional_gradient(const Eigen::MatrixXd& c1, const Eigen::MatrixXd& c2,
                                              const Eigen::VectorXd& a, const Eigen::VectorXd& b,
                                              const Eigen::MatrixXd& start, int max_iterations) {
  check_transport(Eigen::MatrixXd::Zero(c1.rows(), c2.rows()), a, b);
  GwProblem problem;
  problem.c1 = c1;
  problem.c2 = c2;
  problem.tree1 = metric_tree(c1);
  problem.units = mass_units(a, b);
  const double total = static_cast<double>(problem.units.total);
  problem.curvature = 2.0 / total;
  std::vector<PlanCell> cells = plan_cells(start * total);
  GwDescent descent(problem);
  GwConditionalGradient result;
  result.iterations = descent.conditional_gradient(cells, max_iterations);
  result.plan.setZero(c1.rows(), c2.rows());
  for (PlanCell& cell : cells) {
    cell.mass /= total;
    result.plan(cell.row, cell.column) += cell.mass;
  }
  result.cost = problem.sparse(cells.size()) ? gw_cost(problem.c1, problem.c2, cells) : gw_cost(c1, c2, result.plan);
  return result;
}

GromovWasserstein fused_gromov_wasserstein(const Eigen::MatrixXd& features, const Eigen::MatrixXd& c1,
                                           const Eigen::MatrixXd& c2, const Eigen::VectorXd& a,
                                           const Eigen::VectorXd& b, double alpha, const std::vector<GwStart>& starts,
                                           const GromovWassersteinOptions& options) {
  if (!(alpha >= 0.0 && alpha <= 1.0)) throw InputError("", "fused Gromov-Wasserstein", "alpha must lie in [0, 1]");
  if (features.rows() != c1.rows() || features.cols() != c2.rows() || !features.allFinite() ||
      (features.size() > 0 && features.minCoeff() < 0.0)) {
    throw InputError("", "fused Gromov-Wasserstein", "features must be finite, not negative, and of shape [n,m]");
  }
  // The plan that is best for the features alone is a start whatever the caller gives.
  TransportPlan matched = exact_transport(features, a, b);
  if (alpha == 0.0) {
    const double cost = std::max(matched.cost, 0.0);
    return {std::sqrt(cost), cost, std::move(matched.plan), "features", {{"features", cost}}};
  }
  std::vector<GwStart> all = {{"features", std::move(matched.plan)}};
  all.insert(all.end(), starts.begin(), starts.end());
  return GwSearch{c1, c2, a, b, &features, alpha, all, options}.run();
}

EntropicGw entropic_gromov_wasserstein(const Eigen::MatrixXd& distances1, const Eigen::MatrixXd& distances2,
                                       const Eigen::VectorXd& a, const Eigen::VectorXd& b,
                                       const EntropicGwOptions& options) {
  if (!(options.epsilon > 0.0)) throw InputError("", "entropic Gromov-Wasserstein", "epsilon must be positive");
  check_transport(Eigen::MatrixXd::Zero(distances1.rows(), distances2.rows()), a, b);
  const double largest = std::max(distances1.maxCoeff(), distances2.maxCoeff());
  const double scale = largest > 0.0 ? largest : 1.0;
  const Eigen::MatrixXd c1 = distances1 / scale, c2 = distances2 / scale;
  // Half the gradient of Σ (C1_ij − C2_kl)² T_ik T_jl (Peyré, Cuturi and Solomon 2016, proposition 1):
  // 𝓛(T) = C1² a 1ᵀ + 1 (C2² b)ᵀ − 2 C1 T C2.
  const Eigen::VectorXd first = c1.cwiseAbs2() * a, second = c2.cwiseAbs2() * b;

  EntropicGw result;
  result.plan = a * b.transpose();
  double change = 1.0;
  while (change > options.tolerance && result.iterations < options.max_iterations) {
    const Eigen::MatrixXd last = result.plan;
    Eigen::MatrixXd gradient = -4.0 * (c1 * last * c2);
    gradient.colwise() += 2.0 * first;
    gradient.rowwise() += 2.0 * second.transpose();
    if (options.solver == EntropicGwSolver::kProximalPoint) gradient.array() -= options.epsilon * last.array().log();
    result.plan = scaled_kernel(gradient, a, b, options);  // T ← Sinkhorn(2 𝓛(T), ε)
    if (result.iterations % kLookEvery == 0) change = (result.plan - last).norm();
    ++result.iterations;
  }
  const Eigen::VectorXd rows = result.plan.rowwise().sum(), columns = result.plan.colwise().sum();
  result.marginal_error = (rows - a).cwiseAbs().sum() + (columns - b).cwiseAbs().sum();
  result.cost = gw_cost(c1, c2, result.plan) * scale * scale;
  return result;
}

}  // namespace anigen::metrics
