// Optimal transport between joint sets and between tree geodesics, against the published solvers.
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <numeric>
#include <string>
#include <vector>

#include "anigen/core/random.h"
#include "anigen/metrics/entropic_gw.h"
#include "anigen/metrics/gromov_wasserstein.h"
#include "anigen/metrics/gw_bound.h"
#include "anigen/metrics/gw_problem.h"
#include "anigen/metrics/wasserstein.h"
#include "tests/parity/eigen_tensors.h"
#include "tests/parity/registry.h"

namespace anigen::test {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kExactRelative = 1e-9;  // what exact transport promises
constexpr double kGwExcess = 1e-6;  // a Gromov–Wasserstein cost this little above the best published one is as good
constexpr double kGwShare = 0.95;   // of the pairs must be as good
// So many starts may agree with the published end by other numbers only: the share of them, or three of few.
constexpr double kRenumberedShare = 0.25, kRenumberedOfFew = 3.0;

std::string pair_name(std::size_t pair) {
  char text[16];
  std::snprintf(text, sizeof text, "p%02zu.", pair);
  return text;
}

JointTree skeleton(const Fixture& fixture, const std::string& pair, const std::string& side) {
  return {points(fixture.input(pair + "joints" + side)), ints(fixture.input(pair + "parents" + side))};
}

double marginal_error(const MatrixXd& plan, const VectorXd& a, const VectorXd& b) {
  return (plan.rowwise().sum() - a).cwiseAbs().sum() + (plan.colwise().sum().transpose() - b).cwiseAbs().sum();
}

// Optimal plans are unique only up to ties: an equal plan is compared entry by entry, another one by what it must
// share with it, marginals and cost.
void check_plan(Fixture& fixture, const std::string& name, const MatrixXd& plan, const VectorXd& a, const VectorXd& b,
                double cost, double wanted_cost) {
  const MatrixXd wanted = matrix(fixture.expected(name));
  if (plan.rows() == wanted.rows() && plan.cols() == wanted.cols() && (plan - wanted).cwiseAbs().maxCoeff() < 1e-9) {
    fixture.check(name, tensor(plan));
    return;
  }
  fixture.check_true(name + ": a coupling of the same masses", marginal_error(plan, a, b) < 1e-12);
  fixture.check_true(name + ": as cheap", cost <= wanted_cost * (1.0 + kExactRelative) + 1e-12);
  fixture.defer(name, "another vertex of equal or lower cost; compared by cost and marginals above");
}

void check_exact(Fixture& fixture, const std::string& pair, const JointTree& x, const JointTree& y) {
  const VectorXd a = metrics::uniform_masses(x.size()), b = metrics::uniform_masses(y.size());
  const MatrixXd cost = metrics::squared_distances(x.positions, y.positions);
  const double wanted = fixture.expected(pair + "w2_cost").item<double>();
  for (const metrics::ExactSolver solver :
       {metrics::ExactSolver::kNetworkSimplex, metrics::ExactSolver::kShortestPaths}) {
    const metrics::TransportPlan found = metrics::exact_transport(cost, a, b, solver);
    fixture.check(pair + "w2_cost", scalar(found.cost));
    fixture.check(pair + "w2", scalar(metrics::wasserstein2(x.positions, y.positions, solver).distance));
    fixture.check(pair + "w1_cost", scalar(metrics::wasserstein1(x.positions, y.positions, solver).distance));
    fixture.check_true(pair + "w2_cost within 1e-9 of the reference",
                       std::abs(found.cost - wanted) <= kExactRelative * wanted + 1e-15 * cost.maxCoeff());
    check_plan(fixture, pair + "w2_plan", found.plan, a, b, found.cost, wanted);
  }
}

void check_sinkhorn(Fixture& fixture, const std::string& pair, const JointTree& x, const JointTree& y) {
  const MatrixXd cost = metrics::squared_distances(x.positions, y.positions);
  const VectorXd a = metrics::uniform_masses(x.size()), b = metrics::uniform_masses(y.size());
  const std::vector<double> shares = fixture.config().at("reg_rel");
  for (std::size_t k = 0; k < shares.size(); ++k) {
    const std::string name = pair + "sinkhorn" + std::to_string(k);
    // The published solver starts cold, projects columns before rows and stops after 20,000 rounds (see the notes of
    // the fixture), which for a few pairs is before it has converged: the same rounds on the transposed problem.
    metrics::SinkhornOptions options;
    options.epsilon = shares[k];
    options.start_epsilon = 0.0;
    options.tolerance = 1e-13;
    options.max_iterations = 20000;
    options.round = false;
    const metrics::SinkhornResult found = metrics::sinkhorn(cost.transpose(), b, a, options);
    if (!found.converged)
      std::printf("%s: not converged, row masses off by %.1e\n", name.c_str(), found.marginal_error);
    fixture.check(name + "_plan", tensor(found.plan.transpose()));
    fixture.check(name + "_cost", scalar(found.cost));
    fixture.check(name + "_reg", scalar(shares[k] * cost.maxCoeff()));
  }
  const metrics::SinkhornResult bounded = metrics::sinkhorn_wasserstein2(x.positions, y.positions);
  const double exact = fixture.expected(pair + "w2_cost").item<double>(), rounding = 1e-12 * cost.maxCoeff();
  std::printf("%ssinkhorn with default settings: exact %.6g in [%.6g, %.6g]\n", pair.c_str(), exact,
              bounded.lower_bound, bounded.cost);
  fixture.check_true(pair + "sinkhorn within its certified gap of exact",
                     bounded.lower_bound <= exact + rounding && exact <= bounded.cost + rounding);
}

void run_wasserstein(Fixture& fixture) {
  for (std::size_t p = 0; fixture.has_input(pair_name(p) + "joints1"); ++p) {
    const JointTree x = skeleton(fixture, pair_name(p), "1"), y = skeleton(fixture, pair_name(p), "2");
    check_exact(fixture, pair_name(p), x, y);
    check_sinkhorn(fixture, pair_name(p), x, y);
  }
}

// Best permutation by trying all.
double enumerated_cost(const MatrixXd& c1, const MatrixXd& c2) {
  std::vector<int> order(static_cast<std::size_t>(c1.rows()));
  std::iota(order.begin(), order.end(), 0);
  double best = (c1 - c2).squaredNorm();
  do {
    double cost = 0.0;
    for (Eigen::Index i = 0; i < c1.rows() && cost < best; ++i) {
      for (Eigen::Index k = 0; k < c1.rows(); ++k) {
        const double gap = c1(i, k) - c2(order[static_cast<std::size_t>(i)], order[static_cast<std::size_t>(k)]);
        cost += gap * gap;
      }
    }
    best = std::min(best, cost);
  } while (std::next_permutation(order.begin(), order.end()));
  return best / static_cast<double>(c1.rows() * c1.rows());
}

struct Spaces {
  MatrixXd c1, c2;
  VectorXd a, b;
};

struct Descent {
  double first = 0.0, cost = 0.0;
  int iterations = 0;
  MatrixXd plan;
};

// Conditional gradient with the joints of both sides in a random order; the plan is returned in the caller's.
Descent relabelled_descent(const Spaces& spaces, const MatrixXd& start, std::uint64_t shuffle) {
  Rng rng(shuffle, "transport_parity");
  const std::vector<std::size_t> rows = rng.permutation(static_cast<std::size_t>(start.rows()));
  const std::vector<std::size_t> columns = rng.permutation(static_cast<std::size_t>(start.cols()));
  Eigen::PermutationMatrix<Eigen::Dynamic> p(start.rows()), q(start.cols());
  for (Eigen::Index i = 0; i < start.rows(); ++i)
    p.indices()[i] = shuffle == 0 ? static_cast<int>(i) : static_cast<int>(rows[static_cast<std::size_t>(i)]);
  for (Eigen::Index k = 0; k < start.cols(); ++k)
    q.indices()[k] = shuffle == 0 ? static_cast<int>(k) : static_cast<int>(columns[static_cast<std::size_t>(k)]);
  const MatrixXd c1 = p * spaces.c1 * p.transpose(), c2 = q * spaces.c2 * q.transpose();
  const VectorXd a = p * spaces.a, b = q * spaces.b;
  const MatrixXd moved = p * start * q.transpose();
  const metrics::GwConditionalGradient found = metrics::gw_conditional_gradient(c1, c2, a, b, moved);
  return {metrics::gw_conditional_gradient(c1, c2, a, b, moved, 1).cost, found.cost, found.iterations,
          p.transpose() * found.plan * q};
}

// Starts whose result is compared, and those of them that took renumbered joints.
struct Starts {
  int compared = 0, renumbered = 0;
};

// The published conditional gradient from each of its starts. Its linear programs can tie whatever the bone lengths are
// (two joints with half of all joints on either side of their bone have the same mean distance), and then the numbering
// of the joints decides which optimal vertex a solver takes. So where our run ends elsewhere, others with renumbered
// joints are tried: the published result must be one of ours, and for most starts at the first attempt, since a wrong
// descent would end there by chance, too, with enough attempts. Where the fixture itself says that ties decide, its own
// value stands in.
void check_conditional_gradient(Fixture& fixture, const std::string& pair, const Spaces& spaces, Starts& starts) {
  constexpr std::uint64_t kShuffles = 200;
  const std::vector<int> stable = ints(fixture.input(pair + "stable_cg"));
  const std::vector<int> stable_first = ints(fixture.input(pair + "stable_first"));
  const torch::Tensor costs = fixture.expected(pair + "cg_cost").clone();
  const torch::Tensor first = fixture.expected(pair + "first_step_cost").clone();
  const torch::Tensor iterations = fixture.expected(pair + "cg_iters").clone();
  const int best = costs.argmin().item<int>();
  for (int k = 0; fixture.has_input(pair + "init" + std::to_string(k)); ++k) {
    const std::string name = pair + "init" + std::to_string(k);
    const MatrixXd start = matrix(fixture.input(name));
    const double wanted = costs[k].item<double>(), wanted_first = first[k].item<double>();
    const int wanted_iterations = iterations[k].item<int>();
    const bool compare = stable[static_cast<std::size_t>(k)] != 0;
    const bool compare_first = stable_first[static_cast<std::size_t>(k)] != 0;
    const auto near = [](double x, double y) { return std::abs(x - y) <= 1e-8 + 1e-6 * std::abs(y); };
    Descent found = relabelled_descent(spaces, start, 0);
    std::uint64_t shuffle = 0;
    // The published count includes the step that finds nothing better.
    while (shuffle < kShuffles &&
           ((compare && (!near(found.cost, wanted) || found.iterations + 1 != wanted_iterations)) ||
            (compare_first && !near(found.first, wanted_first)))) {
      found = relabelled_descent(spaces, start, ++shuffle);
    }
    starts.compared += compare || compare_first ? 1 : 0;
    starts.renumbered += shuffle > 0 ? 1 : 0;
    if (shuffle > 0) std::printf("%s: ties; agrees with renumbering %d\n", name.c_str(), static_cast<int>(shuffle));
    if (!compare) std::printf("%s: end decided by ties, not compared\n", name.c_str());
    fixture.check_true(name + ": descends to a coupling",
                       found.cost <= metrics::gw_cost(spaces.c1, spaces.c2, start) + 1e-12 &&
                           marginal_error(found.plan, spaces.a, spaces.b) < 1e-12);
    if (compare_first) first[k] = found.first;
    if (compare) {
      costs[k] = found.cost;
      iterations[k] = found.iterations + 1;
    }
    if (k != best) continue;
    if (compare || found.cost <= wanted + kGwExcess) {
      check_plan(fixture, pair + "cg_plan_best", found.plan, spaces.a, spaces.b, found.cost - kGwExcess, wanted);
    } else {
      fixture.defer(pair + "cg_plan_best", "the fixture marks its start as decided by ties, and ours ended elsewhere");
    }
  }
  fixture.check(pair + "cg_cost", costs);
  fixture.check(pair + "first_step_cost", first);
  fixture.check(pair + "best_cost", costs.min().reshape({1}));
  fixture.check(pair + "cg_iters", iterations);
}

void check_entropic(Fixture& fixture, const std::string& pair, const Spaces& spaces, const std::string& name,
                    const metrics::EntropicGwOptions& options, bool stable) {
  const metrics::EntropicGw found =
      metrics::entropic_gromov_wasserstein(spaces.c1, spaces.c2, spaces.a, spaces.b, options);
  const double scale = std::max(spaces.c1.maxCoeff(), spaces.c2.maxCoeff());
  if (stable) {
    fixture.check(pair + name + "_plan", tensor(found.plan));
    fixture.check(pair + name + "_cost", torch::full({1}, found.cost / (scale * scale), torch::kFloat64));
    fixture.check(pair + name + "_marginal_err", torch::full({1}, found.marginal_error, torch::kFloat64));
    return;
  }
  fixture.check_true(pair + name + ": finite, nonnegative", found.plan.allFinite() && found.plan.minCoeff() >= 0.0);
  for (const char* output : {"_plan", "_cost", "_marginal_err"})
    fixture.defer(pair + name + output, "the fixture marks it as unstable under 1e-13 perturbations");
}

void check_entropics(Fixture& fixture, const std::string& pair, const Spaces& spaces) {
  const std::vector<double> epsilons = fixture.config().at("eps");
  const std::vector<int> stable_pgd = ints(fixture.input(pair + "stable_pgd"));
  metrics::EntropicGwOptions options;
  options.max_iterations = fixture.config().at("max_iter_pgd");
  for (std::size_t k = 0; k < epsilons.size(); ++k) {
    options.epsilon = epsilons[k];
    check_entropic(fixture, pair, spaces, "pgd" + std::to_string(k), options, stable_pgd[k] != 0);
  }
  options.solver = metrics::EntropicGwSolver::kProximalPoint;
  options.epsilon = fixture.config().at("ppa_eps");
  options.max_iterations = fixture.config().at("max_iter_ppa");
  check_entropic(fixture, pair, spaces, "ppa", options, ints(fixture.input(pair + "stable_ppa"))[0] != 0);
}

// @return whether our search is as good as the best published start
bool check_search(Fixture& fixture, const std::string& pair, const JointTree& x, const JointTree& y,
                  const Spaces& spaces) {
  const metrics::JointTransport matched = metrics::wasserstein2(x.positions, y.positions);
  const metrics::GromovWasserstein found =
      metrics::gromov_wasserstein(spaces.c1, spaces.c2, spaces.a, spaces.b, {{"wasserstein", matched.plan}});
  const metrics::GwLowerBound bound = metrics::gw_lower_bound(spaces.c1, spaces.c2, spaces.a, spaces.b);
  const double wanted = fixture.expected(pair + "best_cost").item<double>();
  std::printf("%ssearch: cost %.8f, published best %.8f, difference %+.2e, from %s; value %.6f >= bound %.6f\n",
              pair.c_str(), found.cost, wanted, found.cost - wanted, found.start.c_str(), found.value, bound.best);
  fixture.check_true(pair + "lower bound <= value", bound.best <= found.value);
  fixture.check_true(pair + "the search gives a coupling", marginal_error(found.plan, spaces.a, spaces.b) < 1e-12);

  const double enumerated = fixture.expected(pair + "exact_cost").item<double>();
  if (enumerated >= 0.0) {
    const double exact = enumerated_cost(spaces.c1, spaces.c2);
    fixture.check(pair + "exact_cost", torch::full({1}, exact, torch::kFloat64));
    fixture.check_true(pair + "the search finds the global optimum", found.cost <= exact + 1e-9);
    fixture.check_true(pair + "lower bound <= global optimum", bound.best * bound.best <= exact);
  } else {
    fixture.defer(pair + "exact_cost", "too large to enumerate; the fixture holds -1");
  }
  return found.cost <= wanted + kGwExcess;
}

void run_gromov_wasserstein(Fixture& fixture) {
  std::vector<std::string> worse;
  std::size_t pairs = 0;
  Starts starts;
  for (; fixture.has_input(pair_name(pairs) + "joints1"); ++pairs) {
    const std::string pair = pair_name(pairs);
    const JointTree x = skeleton(fixture, pair, "1"), y = skeleton(fixture, pair, "2");
    const Spaces spaces{metrics::tree_geodesics(x), metrics::tree_geodesics(y), metrics::uniform_masses(x.size()),
                        metrics::uniform_masses(y.size())};
    fixture.check(pair + "C1", tensor(spaces.c1));
    fixture.check(pair + "C2", tensor(spaces.c2));
    const MatrixXd product = spaces.a * spaces.b.transpose();
    fixture.check(pair + "product_cost",
                  torch::full({1}, metrics::gw_cost(spaces.c1, spaces.c2, product), torch::kFloat64));
    check_conditional_gradient(fixture, pair, spaces, starts);
    check_entropics(fixture, pair, spaces);
    if (!check_search(fixture, pair, x, y, spaces)) worse.push_back(pair);
  }
  for (const std::string& pair : worse) std::printf("above the published best by more than 1e-6: %s\n", pair.c_str());
  std::printf("%d of %d starts agree with renumbered joints only\n", starts.renumbered, starts.compared);
  fixture.check_true("most starts agree as the joints are numbered",
                     starts.renumbered <= std::max(kRenumberedOfFew, kRenumberedShare * starts.compared));
  std::printf("at most 1e-6 above the published best: %zu of %zu pairs\n", pairs - worse.size(), pairs);
  fixture.check_true("as good as the published best on 95 % of the pairs",
                     static_cast<double>(pairs - worse.size()) >= kGwShare * static_cast<double>(pairs));
}

}  // namespace
}  // namespace anigen::test

ANIGEN_PARITY(ops_ot_w2_sinkhorn, anigen::test::run_wasserstein)
ANIGEN_PARITY(ops_ot_gromov_wasserstein, anigen::test::run_gromov_wasserstein)
