// Couplings that the search for Gromov–Wasserstein distances finds, beside the best known of each pair: from public
// solvers' methods (conditional gradient, projected gradient and proximal point, each from many random couplings), from
// the search itself with many more rounds.
//   benchmark_transport_quality --search FILE.csv [STARTS]   looks for better couplings and writes the best known
//   benchmark_transport_quality FILE.csv [ROUNDS]            compares the search with them; ROUNDS: `perturbations`
// The pairs are drawn from fixed streams: 67 of random trees, 67 of rings, 66 of symmetric creatures with perturbed
// bones, 10 to 120 points a side.
#include <time.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <numeric>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/random.h"
#include "anigen/core/table.h"
#include "anigen/metrics/gromov_wasserstein.h"
#include "anigen/metrics/gw_problem.h"
#include "anigen/metrics/sinkhorn.h"
#include "anigen/metrics/transport_plan.h"

namespace {

using anigen::JointTree;
using anigen::Rng;
using anigen::metrics::uniform_masses;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kPairs = 200;
constexpr double kEqual = 1e-6;  ///< relative: below this two values are the same coupling's, rounded

struct Pair {
  std::string family;
  MatrixXd c1, c2;
  VectorXd a, b;
};

double computed_ms() {
  timespec time{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

std::size_t drawn_size(Rng& rng) {
  return static_cast<std::size_t>(std::lround(10.0 * std::pow(12.0, rng.uniform())));  // 10 … 120, evenly in log
}

Eigen::Vector3d drawn_step(Rng& rng, double length) {
  return length * Eigen::Vector3d(rng.normal(), rng.normal(), rng.normal());
}

void add_joint(JointTree& tree, int parent, const Eigen::Vector3d& step) {
  tree.positions.push_back(parent < 0 ? step
                                      : Eigen::Vector3d(tree.positions[static_cast<std::size_t>(parent)] + step));
  tree.parents.push_back(parent);
}

JointTree random_tree(std::size_t joints, Rng& rng) {
  JointTree tree;
  for (std::size_t j = 0; j < joints; ++j) {
    const std::size_t parent = rng.chance(0.7) || j == 0 ? j - 1 : rng.index(j);
    add_joint(tree, j == 0 ? -1 : static_cast<int>(parent), drawn_step(rng, 0.1));
  }
  return tree;
}

/// A spine with pairs of equal limbs, a head and a tail.
JointTree symmetric_creature(std::size_t joints, Rng& rng) {
  JointTree tree;
  const std::size_t pairs = 1 + rng.index(4);
  const std::size_t limb = std::max<std::size_t>(1, (joints * 3 / 5) / (2 * pairs));
  const std::size_t spine = std::max<std::size_t>(2, joints - 2 * pairs * limb);
  for (std::size_t j = 0; j < spine; ++j) add_joint(tree, static_cast<int>(j) - 1, {0.0, 0.12, 0.02 * rng.normal()});
  const double first = 0.08 + 0.1 * rng.uniform();
  for (std::size_t p = 0; p < pairs; ++p) {
    const int root = static_cast<int>(rng.index(spine));
    std::vector<double> lengths;
    for (std::size_t k = 0; k < limb; ++k) lengths.push_back(first * (1.0 + 0.1 * rng.normal()));
    for (const double side : {-1.0, 1.0}) {
      int parent = root;
      for (const double length : lengths) {
        add_joint(tree, parent, {side * length, 0.0, 0.0});
        parent = static_cast<int>(tree.size()) - 1;
      }
    }
  }
  return tree;
}

/// Bones lengthened or shortened by about `share` of themselves; now and then a joint more at the end of a chain.
JointTree perturbed(const JointTree& tree, double share, Rng& rng) {
  JointTree result;
  for (std::size_t j = 0; j < tree.size(); ++j) {
    const int parent = tree.parents[j];
    const Eigen::Vector3d step =
        parent < 0 ? tree.positions[j]
                   : Eigen::Vector3d(tree.positions[j] - tree.positions[static_cast<std::size_t>(parent)]);
    add_joint(result, parent, step * (1.0 + share * rng.normal()));
  }
  for (std::size_t k = rng.index(4); k > 0; --k)
    add_joint(result, static_cast<int>(rng.index(result.size())), drawn_step(rng, 0.06));
  return result;
}

MatrixXd ring_distances(std::size_t points, Rng& rng) {
  std::vector<double> places(points);
  double length = 0.0;
  for (double& place : places) {
    place = length;
    length += rng.uniform(0.2, 1.0);
  }
  return anigen::metrics::matrix_of(points, points, [&](std::size_t i, std::size_t k) {
    const double along = std::abs(places[i] - places[k]);
    return std::min(along, length - along) / length;
  });
}

Pair pair_of(std::size_t index) {
  Rng rng(0, "transport_quality", index);
  Pair pair;
  const std::size_t n = drawn_size(rng);
  if (index % 3 == 0) {
    pair.family = "random trees";
    const JointTree tree = random_tree(n, rng);
    pair.c1 = anigen::metrics::tree_geodesics(tree);
    pair.c2 =
        anigen::metrics::tree_geodesics(index % 2 == 0 ? perturbed(tree, 0.2, rng) : random_tree(drawn_size(rng), rng));
  } else if (index % 3 == 1) {
    pair.family = "rings";
    pair.c1 = ring_distances(n, rng);
    pair.c2 = ring_distances(drawn_size(rng), rng);
  } else {
    pair.family = "symmetric creatures";
    const JointTree tree = symmetric_creature(n, rng);
    pair.c1 = anigen::metrics::tree_geodesics(tree);
    pair.c2 = anigen::metrics::tree_geodesics(index % 2 == 0 ? perturbed(tree, 0.02, rng)
                                                             : symmetric_creature(drawn_size(rng), rng));
  }
  pair.a = uniform_masses(static_cast<std::size_t>(pair.c1.rows()));
  pair.b = uniform_masses(static_cast<std::size_t>(pair.c2.rows()));
  return pair;
}

/// Scales a positive matrix to the masses.
MatrixXd scaled(MatrixXd plan, const Pair& pair, int rounds) {
  for (int round = 0; round < rounds; ++round) {
    plan.array().colwise() *= pair.a.array() / plan.rowwise().sum().array();
    plan.array().rowwise() *= (pair.b.array() / plan.colwise().sum().transpose().array()).transpose();
  }
  return plan;
}

MatrixXd random_coupling(const Pair& pair, Rng& rng) {
  MatrixXd plan(pair.c1.rows(), pair.c2.rows());
  for (double& value : plan.reshaped()) value = std::pow(rng.uniform(1e-3, 1.0), 4.0);
  return scaled(std::move(plan), pair, 200);
}

/// Projected gradient (proximal: false) and proximal point (true) as they are printed: T ← Sinkhorn of exp(−G/ε), times
/// T for the proximal one. The end is rounded to a coupling and descends by conditional gradient.
double entropic_descent(const Pair& pair, MatrixXd plan, double epsilon, bool proximal) {
  const double largest = std::max(pair.c1.maxCoeff(), pair.c2.maxCoeff());
  const MatrixXd c1 = pair.c1 / largest, c2 = pair.c2 / largest;
  const VectorXd p = c1.cwiseAbs2() * pair.a, q = c2.cwiseAbs2() * pair.b;
  for (int iteration = 0; iteration < 60; ++iteration) {
    MatrixXd gradient = -4.0 * c1 * plan * c2;
    gradient.colwise() += 2.0 * p;
    gradient.rowwise() += 2.0 * q.transpose();
    gradient.array() -= gradient.minCoeff();
    MatrixXd kernel = (-gradient / epsilon).array().max(-200.0).exp();
    if (proximal) kernel = kernel.cwiseProduct(plan);
    kernel.array() += 1e-300;
    const MatrixXd next = scaled(std::move(kernel), pair, 50);
    if (!next.allFinite()) break;
    const double moved = (next - plan).cwiseAbs().sum();
    plan = next;
    if (moved < 1e-5) break;
  }
  const MatrixXd start = anigen::metrics::round_to_coupling(plan, pair.a, pair.b);
  return anigen::metrics::gw_conditional_gradient(pair.c1, pair.c2, pair.a, pair.b, start).cost;
}

struct Best {
  double cost = 0.0;
  std::string by;
};

void take(Best& best, double cost, const std::string& by) {
  if (best.by.empty() || cost < best.cost * (1.0 - kEqual)) best = {cost, by};
}

Best best_of(const Pair& pair, std::size_t index, int starts) {
  Best best;
  anigen::metrics::GromovWassersteinOptions patient;
  patient.descents = 8;
  patient.perturbations = 6000;
  for (const std::uint64_t seed : {0, 1, 2}) {
    patient.seed = seed;
    take(best, anigen::metrics::gromov_wasserstein(pair.c1, pair.c2, pair.a, pair.b, {}, patient).cost, "search");
  }
  Rng rng(0, "transport_quality_starts", index);
  for (int start = 0; start < starts; ++start) {
    const MatrixXd plan = random_coupling(pair, rng);
    take(best, anigen::metrics::gw_conditional_gradient(pair.c1, pair.c2, pair.a, pair.b, plan).cost,
         "conditional gradient");
    take(best, entropic_descent(pair, plan, 0.005, false), "projected gradient");
    take(best, entropic_descent(pair, plan, 0.05, true), "proximal point");
  }
  return best;
}

void search(const std::string& file, int starts) {
  std::vector<Best> found(kPairs);
  std::map<std::string, Best> known;
  if (std::filesystem::exists(file)) {
    const anigen::CsvTable table = anigen::read_csv(file);
    for (std::size_t row = 0; row < table.rows.size(); ++row)
      known[table.cell(row, "pair")] = {std::stod(table.cell(row, "cost")), table.cell(row, "by")};
  }
  anigen::parallel_for(kPairs, [&](std::size_t i) {
    found[i] = best_of(pair_of(i), i, starts);
    std::fprintf(stderr, "pair %zu: %.6g by %s\n", i, found[i].cost, found[i].by.c_str());
    const auto before = known.find(std::to_string(i));
    if (before != known.end()) {
      Best best = before->second;
      take(best, found[i].cost, found[i].by);
      found[i] = best;
    }
  });
  std::string text = "pair,family,n,m,cost,by\n";
  for (std::size_t i = 0; i < kPairs; ++i) {
    const Pair pair = pair_of(i);
    char line[200];
    std::snprintf(line, sizeof line, "%zu,%s,%td,%td,%.12g,%s\n", i, pair.family.c_str(), pair.c1.rows(),
                  pair.c2.rows(), found[i].cost, found[i].by.c_str());
    text += line;
  }
  anigen::write_file_atomically(file, text);
}

struct Row {
  std::size_t pairs = 0, reached = 0, better = 0;
  double worst = 0.0;
  std::vector<double> milliseconds;
};

void compare(const std::string& file, const anigen::metrics::GromovWassersteinOptions& options) {
  const anigen::CsvTable table = anigen::read_csv(file);
  if (table.rows.size() != kPairs) throw anigen::InputError(file, "", "has not one row for each of the 200 pairs");
  std::map<std::string, Row> rows;
  double small = 0.0;
  std::size_t smalls = 0;
  for (std::size_t i = 0; i < kPairs; ++i) {
    const Pair pair = pair_of(i);
    const double began = computed_ms();
    const double cost = anigen::metrics::gromov_wasserstein(pair.c1, pair.c2, pair.a, pair.b, {}, options).cost;
    const double took = computed_ms() - began;
    const double best = std::stod(table.cell(i, "cost"));
    const double miss = std::sqrt(cost / best) - 1.0;
    if (std::max(pair.c1.rows(), pair.c2.rows()) <= 80) small += took, ++smalls;
    if (miss > kEqual)
      std::printf("  pair %zu (%s, %td x %td): %.3f %% above %s\n", i, pair.family.c_str(), pair.c1.rows(),
                  pair.c2.rows(), 100.0 * miss, table.cell(i, "by").c_str());
    for (const std::string& name : {pair.family, std::string("all")}) {
      Row& row = rows[name];
      ++row.pairs;
      row.reached += miss <= kEqual ? 1 : 0;
      row.better += miss < -kEqual ? 1 : 0;
      row.worst = std::max(row.worst, miss);
      row.milliseconds.push_back(took);
    }
  }
  std::printf("%-20s %6s %8s %8s %9s %9s %9s %9s\n", "family", "pairs", "reached", "better", "worst %", "median ms",
              "95 % ms", "max ms");
  for (auto& [name, of_name] : rows) {
    Row& row = of_name;  // a lambda takes it
    std::sort(row.milliseconds.begin(), row.milliseconds.end());
    const auto at = [&](double share) {
      return row.milliseconds[static_cast<std::size_t>(share * static_cast<double>(row.pairs - 1))];
    };
    std::printf("%-20s %6zu %8zu %8zu %9.4f %9.2f %9.2f %9.2f\n", name.c_str(), row.pairs, row.reached, row.better,
                100.0 * row.worst, at(0.5), at(0.95), at(1.0));
  }
  std::printf("mean of the %zu pairs of up to 80 points: %.2f ms\n", smalls, small / static_cast<double>(smalls));
}

}  // namespace

int main(int argc, char** argv) {
  anigen::keep_freed_memory();
  const std::vector<std::string> words(argv + 1, argv + argc);
  try {
    if (words.size() >= 2 && words[0] == "--search")
      return search(words[1], words.size() > 2 ? std::stoi(words[2]) : 100), 0;
    anigen::metrics::GromovWassersteinOptions options;
    if (words.size() == 2) options.perturbations = std::stoi(words[1]);
    if (words.size() == 1 || words.size() == 2) return compare(words[0], options), 0;
  } catch (const anigen::Error& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 2;
  }
  std::fputs("usage: benchmark_transport_quality FILE.csv [ROUNDS] | --search FILE.csv [STARTS]\n", stderr);
  return 2;
}
