// Cost of optimal transport of skeletons: per fixture pair beside LEMON and the published timings, growth with the
// number of joints, and a thousand pairs in one go. Prints tables; with --benchmark_out=FILE also Google Benchmark's
// JSON, so that one script reads all benchmarks. Other --benchmark_* flags are accepted and ignored.
#include <sys/resource.h>

#include <time.h>

#include <Eigen/Core>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/files.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/random.h"
#include "anigen/core/table.h"
#include "anigen/eval/pair.h"
#include "anigen/io/arrays/safetensors.h"
#include "anigen/metrics/gw_problem.h"
#include "anigen/metrics/skeleton_transport.h"
#include "anigen/metrics/wasserstein.h"
#include "benchmarks/benchmark_flags.h"

namespace {

namespace fs = std::filesystem;
using anigen::JointTree;

struct Entry {
  std::string name;
  double milliseconds;
};
std::vector<Entry> entries;

double now_ms() {
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// Time this thread computed: what a busy machine adds by making it wait does not count.
double computed_ms() {
  timespec time{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

// Median over repetitions, as many as fit in about 0.2 s, at least 3.
template <typename Work>
double median_ms(const std::string& name, const Work& work) {
  work();
  std::vector<double> times;
  for (const double start = now_ms(); times.size() < 3 || (now_ms() - start < 200.0 && times.size() < 101);) {
    const double begin = computed_ms();
    work();
    times.push_back(computed_ms() - begin);
  }
  std::nth_element(times.begin(), times.begin() + static_cast<std::ptrdiff_t>(times.size() / 2), times.end());
  entries.push_back({name, times[times.size() / 2]});
  return entries.back().milliseconds;
}

struct Pair {
  std::string name;
  JointTree x, y;
};

struct Timing {
  double everything, gw, bound, exact, lemon;
  anigen::metrics::SkeletonTransport found;
};

Timing time_pair(const Pair& pair) {
  using namespace anigen::metrics;
  Timing timing;
  timing.everything =
      median_ms(pair.name + "/skeleton_transport", [&] { timing.found = skeleton_transport(pair.x, pair.y); });
  const Eigen::MatrixXd c1 = tree_geodesics(pair.x), c2 = tree_geodesics(pair.y);
  const Eigen::VectorXd a = uniform_masses(pair.x.size()), b = uniform_masses(pair.y.size());
  const Eigen::MatrixXd plan = wasserstein2(pair.x.positions, pair.y.positions).plan;
  timing.gw = median_ms(pair.name + "/gromov_wasserstein", [&] {
    gromov_wasserstein(c1, c2, a, b, {{"wasserstein", plan}});
  });
  timing.bound = median_ms(pair.name + "/gw_lower_bound", [&] { gw_lower_bound(c1, c2, a, b); });
  timing.exact = median_ms(pair.name + "/wasserstein", [&] { wasserstein2(pair.x.positions, pair.y.positions); });
  timing.lemon = median_ms(pair.name + "/wasserstein_lemon",
                           [&] { wasserstein2(pair.x.positions, pair.y.positions, ExactSolver::kNetworkSimplex); });
  return timing;
}

fs::path parity_dir() {
  const char* folder = std::getenv("ANIGEN_PARITY_DIR");
  if (folder != nullptr && *folder != '\0') return folder;
  return fs::path(ANIGEN_SOURCE_DIR).parent_path() / "shared" / "parity";
}

JointTree skeleton(const anigen::io::NamedArrays& tensors, const std::string& pair, const std::string& side) {
  const auto* joints = anigen::io::find(tensors, "in." + pair + ".joints" + side);
  const auto* parents = anigen::io::find(tensors, "in." + pair + ".parents" + side);
  JointTree tree;
  if (joints == nullptr || parents == nullptr) return tree;
  const std::vector<double> values = joints->as<double>();
  for (std::size_t i = 0; i + 2 < values.size(); i += 3)
    tree.positions.emplace_back(values[i], values[i + 1], values[i + 2]);
  for (const std::int64_t parent : parents->as<std::int64_t>()) tree.parents.push_back(static_cast<int>(parent));
  return tree;
}

void fixture_pairs() {
  const fs::path folder = parity_dir(), file = folder / "ops_ot_gromov_wasserstein.safetensors";
  if (!fs::exists(file)) {
    std::printf("fixture pairs: skipped, %s is missing\n", file.c_str());
    return;
  }
  const auto tensors = anigen::io::read_safetensors(file).tensors;
  anigen::CsvTable reference;
  if (fs::exists(folder / "ops_ot_timings_pot.csv")) reference = anigen::read_csv(folder / "ops_ot_timings_pot.csv");
  std::printf(
      "Fixture pairs, median milliseconds of one thread's computing time. POT: published timings of the same pairs, "
      "its\n"
      "Gromov-Wasserstein by conditional gradient from the product start only.\n");
  std::printf("%-5s %-13s %4s %4s | %9s %9s %9s | %9s %9s | %9s %9s | %-10s %-10s %-10s %s\n", "pair", "kind", "n", "m",
              "all", "GW", "bound", "W exact", "W LEMON", "POT W", "POT GW", "value", "bound", "ref value", "start");
  std::vector<double> all, gw, large;
  for (std::size_t p = 0;; ++p) {
    char name[16];
    std::snprintf(name, sizeof name, "p%02zu", p);
    Pair pair{name, skeleton(tensors, name, "1"), skeleton(tensors, name, "2")};
    if (pair.x.size() == 0) break;
    const Timing t = time_pair(pair);
    const bool known = p < reference.rows.size();
    const auto* best = anigen::io::find(tensors, std::string("out.") + name + ".best_cost");
    std::printf("%-5zu %-13s %4zu %4zu | %9.3f %9.3f %9.3f | %9.4f %9.4f | %9s %9s | %-10.6f %-10.6f %-10.6f %s\n", p,
                known ? reference.cell(p, "kind").c_str() : "", pair.x.size(), pair.y.size(), t.everything, t.gw,
                t.bound, t.exact, t.lemon, known ? reference.cell(p, "emd_w2_ms").c_str() : "",
                known ? reference.cell(p, "gw_cg_product_init_ms").c_str() : "", t.found.gromov_wasserstein,
                t.found.gw_lower_bound, best == nullptr ? 0.0 : std::sqrt(std::max(0.0, best->as<double>()[0])),
                t.found.gw_start.c_str());
    all.push_back(t.everything);
    gw.push_back(t.gw);
  }
  if (all.empty()) return;
  std::sort(all.begin(), all.end());
  std::sort(gw.begin(), gw.end());
  std::printf("median over pairs: all %.3f ms, GW with every start %.3f ms; largest: all %.3f ms, GW %.3f ms\n\n",
              all[all.size() / 2], gw[gw.size() / 2], all.back(), gw.back());
}

// A random tree that grows like a skeleton: joints hang mostly on the last one, sometimes on an earlier one.
JointTree random_tree(std::size_t joints, anigen::Rng& rng) {
  JointTree tree;
  for (std::size_t j = 0; j < joints; ++j) {
    const std::size_t parent = j == 0 ? 0 : (rng.chance(0.7) ? j - 1 : rng.index(j));
    const Eigen::Vector3d step(rng.normal(), rng.normal(), rng.normal());
    tree.parents.push_back(j == 0 ? -1 : static_cast<int>(parent));
    tree.positions.push_back(j == 0 ? Eigen::Vector3d(0, 0, 0) : Eigen::Vector3d(tree.positions[parent] + 0.1 * step));
  }
  return tree;
}

JointTree perturbed(const JointTree& tree, anigen::Rng& rng) {
  JointTree result = tree;
  for (Eigen::Vector3d& p : result.positions) p += 0.01 * Eigen::Vector3d(rng.normal(), rng.normal(), rng.normal());
  // Now and then a leaf more.
  const std::size_t extra = rng.index(4);
  for (std::size_t k = 0; k < extra; ++k) {
    const std::size_t parent = rng.index(result.size());
    result.parents.push_back(static_cast<int>(parent));
    result.positions.push_back(result.positions[parent] +
                               0.1 * Eigen::Vector3d(rng.normal(), rng.normal(), rng.normal()));
  }
  return result;
}

void growth() {
  std::printf(
      "Growth, unrelated random trees of n and n joints, milliseconds of computing time\n%5s | %9s %9s %9s | %9s %9s | "
      "%-9s %-9s\n",
      "n", "all", "GW", "bound", "W exact", "W LEMON", "GW value", "bound");
  for (const std::size_t n : {20, 40, 80, 160, 320}) {
    anigen::Rng rng(0, "transport_growth", n);
    Pair pair{"growth" + std::to_string(n), random_tree(n, rng), random_tree(n, rng)};
    const Timing t = time_pair(pair);
    std::printf("%5zu | %9.3f %9.3f %9.3f | %9.4f %9.4f | %-9.5f %-9.5f\n", n, t.everything, t.gw, t.bound, t.exact,
                t.lemon, t.found.gromov_wasserstein, t.found.gw_lower_bound);
  }
  std::printf("\n");
}

void thousand_pairs() {
  constexpr std::size_t kPairs = 1000;
  std::vector<Pair> pairs;
  for (std::size_t i = 0; i < kPairs; ++i) {
    anigen::Rng rng(0, "transport_pairs", i);
    const JointTree truth = random_tree(10 + rng.index(51), rng);
    pairs.push_back({"", i % 2 == 0 ? perturbed(truth, rng) : random_tree(10 + rng.index(51), rng), truth});
  }
  // Skeletons alone: every skeleton, transport and Anymate metric, through the same call as anigen-eval.
  anigen::eval::PairSettings settings;
  settings.groups = {"skeleton", "transport", "anymate"};
  settings.alignment.icp = false;
  settings.alignment.normalization = anigen::metrics::NormalizationMode::kNone;
  const auto shape = [](const JointTree& tree) {
    anigen::io::RiggedShape result;
    result.joints = tree;
    return result;
  };
  std::vector<anigen::eval::PairResult> found(kPairs);
  const double begin = now_ms();
  anigen::parallel_for(kPairs, [&](std::size_t i) {
    found[i] = anigen::eval::evaluate_pair(shape(pairs[i].x), shape(pairs[i].y), settings);
  });
  const double took = now_ms() - begin;
  entries.push_back({"thousand_pairs", took});
  double related = 0.0, unrelated = 0.0, tightness = 0.0;
  for (std::size_t i = 0; i < kPairs; ++i) {
    const double value = found[i].value("gromov_wasserstein");
    (i % 2 == 0 ? related : unrelated) += value;
    tightness += found[i].value("gw_lower_bound") / value;
  }
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  std::printf(
      "%zu synthetic pairs of 10 to 60 joints, all skeleton and transport metrics, %d threads: %.2f s; peak memory "
      "of this program %.0f MiB\n",
      kPairs, anigen::thread_count(), took / 1000.0, static_cast<double>(usage.ru_maxrss) / 1024.0);
  std::printf("mean GW of perturbed copies %.4f, of unrelated trees %.4f; mean lower bound / value %.3f\n",
              2.0 * related / kPairs, 2.0 * unrelated / kPairs, tightness / kPairs);
}

void write_json(const std::string& file) {
  anigen::Json list = anigen::Json::array();
  for (const Entry& entry : entries) {
    list.push_back({{"name", "transport/" + entry.name},
                    {"run_type", "iteration"},
                    {"iterations", 1},
                    {"real_time", entry.milliseconds},
                    {"cpu_time", entry.milliseconds},
                    {"time_unit", "ms"}});
  }
  const anigen::Json json = {{"context", {{"executable", "benchmark_transport"}}}, {"benchmarks", list}};
  anigen::write_file_atomically(file, json.dump(2) + "\n");
}

}  // namespace

int main(int argc, char** argv) {
  anigen::keep_freed_memory();  // as anigen-eval does
  const std::optional<anigen::BenchmarkFlags> flags = anigen::benchmark_flags(argc, argv);
  if (!flags) return 2;
  fixture_pairs();
  growth();
  thousand_pairs();
  if (!flags->out.empty()) write_json(flags->out);
  return 0;
}
