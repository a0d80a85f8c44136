#include "anigen/metrics/gromov_wasserstein.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"
#include "anigen/metrics/entropic_gw.h"
#include "anigen/metrics/gw_bound.h"
#include "anigen/metrics/gw_descent.h"
#include "anigen/metrics/gw_problem.h"
#include "anigen/metrics/sinkhorn.h"
#include "anigen/metrics/transport_plan.h"
#include "anigen/metrics/wasserstein.h"

namespace anigen::metrics {

namespace {

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

// A search that still improves goes on: until it has done so many times the rounds that its last improvement took.
constexpr double kPatience = 4.0, kMostPatience = 12.0;
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
  if (!numbers.problem.tree1 || !numbers.problem.tree2)
    for (GwSparseStart& start : cyclic_starts(numbers.problem)) starts.push_back(std::move(start));
  if (search.options.entropic) starts.push_back({"entropic", entropic_start(numbers)});
  return starts;
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
    const bool trees = problem.tree1 && problem.tree2;
    bool exchanged = false;
    const double affordable =
        std::min(1.0, kFullSearchCells / static_cast<double>(problem.c1.rows() * problem.c2.rows()));
    const double least = options.perturbations * affordable;
    double rounds = least;
    for (int round = 0; round < rounds; ++round) {
      const int kind = problem.units.uniform ? round % 5 : 0;
      const double reached = kind == 0                ? descent.perturb(best, 2 + round % 4, rng)
                             : trees && kind % 2 == 0 ? descent.perturb_branches(best, rng)
                                                      : descent.perturb_neighbourhoods(best, rng);
      if (reached >= best.objective - resolution) continue;
      best = descent.current();
      exchanged = true;
      rounds = std::max(rounds, std::min(kPatience * (round + 0.1 * least), kMostPatience * least));
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

}  // namespace anigen::metrics
