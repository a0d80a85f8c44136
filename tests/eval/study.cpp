#include "tests/eval/study.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "anigen/asset/mesh.h"
#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/core/random.h"
#include "anigen/core/text.h"
#include "anigen/eval/metric_table.h"
#include "anigen/eval/skin_evaluation.h"
#include "anigen/metrics/similarity.h"

namespace anigen::eval {

namespace {

double extent(const JointTree& tree) {
  Box box;
  for (const Eigen::Vector3d& position : tree.positions) box.extend(position);
  return box.longest_side();
}

/// Joints in the subtree of each joint: bits would do, but skeletons are small.
std::vector<std::vector<int>> subtrees(const JointTree& tree) {
  std::vector<std::vector<int>> result(tree.size());
  for (std::size_t j = 0; j < tree.size(); ++j) {
    for (int above = static_cast<int>(j); above >= 0; above = tree.parents[at(above)])
      result[at(above)].push_back(static_cast<int>(j));
  }
  return result;
}

/// Top of the largest subtree that holds at most half of the joints; the lowest index of equals.
int branch(const io::RiggedShape& shape, const std::vector<std::vector<int>>& of) {
  int best = -1;
  for (std::size_t j = 0; j < of.size(); ++j) {
    if (shape.joints.parents[j] < 0 || 2 * of[j].size() > of.size()) continue;
    if (best < 0 || of[j].size() > of[at(best)].size()) best = static_cast<int>(j);
  }
  if (best < 0) throw InputError(shape.file, "", "no branch of at most half of its joints");
  return best;
}

/// Rebuilds every row by a function of it.
template <typename Change>
void change_rows(SkinWeights& skin, Change change) {
  SkinWeights result;
  for (std::size_t v = 0; v < skin.rows(); ++v) {
    std::vector<Influence> row(skin.row(v), skin.row(v) + skin.row_size(v));
    result.append_row(change(std::move(row)));
  }
  skin = std::move(result);
}

// One symbol per studied metric: 0 stays about zero, + sees the mistake, ? nobody said.
constexpr std::array<const char*, 9> kStudied = {"j2j",
                                                 "j2b",
                                                 "b2b",
                                                 "wasserstein",
                                                 "gromov_wasserstein",
                                                 "connectivity_recall",
                                                 "tree_edit_distance",
                                                 "skin_l1",
                                                 "deformation_error"};

std::vector<std::pair<std::string, Expected>> expectations(const std::string& symbols) {
  std::vector<std::pair<std::string, Expected>> result;
  for (std::size_t i = 0; i < kStudied.size(); ++i) {
    const char symbol = symbols.at(i);
    result.emplace_back(kStudied[i], symbol == '0'   ? Expected::kZero
                                     : symbol == '+' ? Expected::kPositive
                                                     : Expected::kOpen);
  }
  return result;
}

/// Distances that are zero between equal shapes. UniRig's J2B is not among them: its samples leave out one end of every
/// bone, so a joint without children is not on any.
const std::vector<std::string>& zero_keys() {
  static const std::vector<std::string> kKeys = {
      "j2j",          "j2b",        "b2b",        "wasserstein",       "gromov_wasserstein", "fused_gromov_wasserstein",
      "skin_l1",      "skin_l2",    "skin_kl",    "deformation_error", "surface_chamfer",    "rignet.j2j",
      "rignet.j2b",   "rignet.b2b", "unirig.j2j", "unirig.b2b",        "puppeteer.j2j",      "puppeteer.j2b",
      "puppeteer.b2b"};
  return kKeys;
}

bool is_skeleton_key(const std::string& key) {
  const MetricInfo* metric = find_metric(key);
  return metric != nullptr && (metric->group == "skeleton" || metric->group == "transport");
}

struct Largest {
  double value = 0;
  std::string key;
};

/// The largest finite value of the keys; divergences may be negative by rounding.
Largest largest(const PairResult& result, bool skeleton_only) {
  Largest found;
  for (const std::string& key : zero_keys()) {
    if (skeleton_only && !is_skeleton_key(key)) continue;
    const double value = std::abs(result.value(key));
    if (std::isfinite(value) && value >= found.value) found = {value, key};
  }
  return found;
}

std::string scientific(double value) {
  if (value == 0) return "0";
  char text[32];
  std::snprintf(text, sizeof text, "%.1e", value);
  return text;
}

PairSettings unaligned() {
  PairSettings settings;
  settings.alignment.icp = false;
  settings.alignment.normalization = metrics::NormalizationMode::kBoundingBox;
  settings.groups = {"skeleton", "transport", "skin"};
  return settings;
}

/// Distance of a metric from its perfect value.
double loss(const PairResult& result, const MetricInfo& metric) {
  const double value = result.value(metric.key);
  return metric.better == Better::kHigher ? 1.0 - value : value;
}

std::string word(Expected expected) {
  return word_of({{Expected::kZero, "about 0"}, {Expected::kPositive, "> 0"}, {Expected::kOpen, "open"}}, expected);
}

double median(std::vector<double> values) { return summarize(std::move(values)).median; }

}  // namespace

io::RiggedShape with_inserted_joint(io::RiggedShape shape) {
  JointTree& tree = shape.joints;
  int child = -1;
  double longest = 0;
  for (std::size_t j = 0; j < tree.size(); ++j) {
    if (tree.parents[j] < 0) continue;
    const double length = (tree.positions[j] - tree.positions[at(tree.parents[j])]).norm();
    if (length > longest) longest = length, child = static_cast<int>(j);
  }
  if (child < 0) throw InputError(shape.file, "", "no bone to insert a joint into");
  const int parent = tree.parents[at(child)];
  const Eigen::Vector3d middle = 0.5 * (tree.positions[at(child)] + tree.positions[at(parent)]);
  tree.parents[at(child)] = static_cast<int>(tree.size());
  tree.positions.push_back(middle);
  tree.parents.push_back(parent);
  if (!shape.joint_names.empty()) shape.joint_names.push_back("inserted");
  return shape;
}

io::RiggedShape with_duplicated_branch(io::RiggedShape shape, double offset) {
  JointTree& tree = shape.joints;
  const auto of = subtrees(tree);
  const int top = branch(shape, of);
  const Eigen::Vector3d shift = offset * extent(tree) * Eigen::Vector3d::UnitX();
  std::vector<int> copy(tree.size(), -1);
  for (const int j : of[at(top)]) {
    copy[at(j)] = static_cast<int>(tree.size());
    tree.positions.push_back(tree.positions[at(j)] + shift);
    tree.parents.push_back(tree.parents[at(j)]);
    if (!shape.joint_names.empty()) shape.joint_names.push_back(shape.joint_names[at(j)] + "_copy");
  }
  // Inside the branch the copies hang on copies.
  for (const int j : of[at(top)]) {
    int& parent = tree.parents[at(copy[at(j)])];
    if (j != top) parent = copy[at(parent)];
  }
  change_rows(shape.skin, [&](std::vector<Influence> row) {
    const std::size_t count = row.size();
    for (std::size_t i = 0; i < count; ++i) {
      const int other = copy[at(row[i].joint)];
      if (other < 0) continue;
      row[i].weight *= 0.5f;
      row.push_back({other, row[i].weight});
    }
    return row;
  });
  return shape;
}

io::RiggedShape with_reparented_subtree(io::RiggedShape shape) {
  JointTree& tree = shape.joints;
  const auto of = subtrees(tree);
  const int top = branch(shape, of);
  const auto& inside = of[at(top)];
  const int parent = tree.parents[at(top)];
  int farthest = -1;
  double largest = -1;
  for (std::size_t j = 0; j < tree.size(); ++j) {
    const int joint = static_cast<int>(j);
    if (joint == parent || std::find(inside.begin(), inside.end(), joint) != inside.end()) continue;
    const double distance = (tree.positions[j] - tree.positions[at(parent)]).norm();
    if (distance > largest) largest = distance, farthest = joint;
  }
  if (farthest < 0) throw InputError(shape.file, "", "no other joint to hang a branch on");
  tree.parents[at(top)] = farthest;
  return shape;
}

io::RiggedShape with_dropped_joints(io::RiggedShape shape, std::uint64_t seed, double fraction) {
  const JointTree before = shape.joints;
  std::vector<int> candidates;
  for (std::size_t j = 0; j < before.size(); ++j) {
    if (before.parents[j] >= 0) candidates.push_back(static_cast<int>(j));
  }
  if (candidates.empty()) throw InputError(shape.file, "", "no joint but roots: nothing to drop");
  const auto count = std::clamp<std::size_t>(
      static_cast<std::size_t>(std::lround(fraction * static_cast<double>(before.size()))), 1, candidates.size());
  Rng rng(seed, "dropped joints");
  const std::vector<std::size_t> order = rng.permutation(candidates.size());
  std::vector<char> dropped(before.size(), 0);
  for (std::size_t i = 0; i < count; ++i) dropped[at(candidates[order[i]])] = 1;

  const auto kept_ancestor = [&](int joint) {
    while (joint >= 0 && dropped[at(joint)]) joint = before.parents[at(joint)];
    return joint;
  };
  std::vector<int> place(before.size(), -1);
  shape.joints = {};
  std::vector<std::string> names;
  for (std::size_t j = 0; j < before.size(); ++j) {
    if (dropped[j]) continue;
    place[j] = static_cast<int>(shape.joints.size());
    shape.joints.positions.push_back(before.positions[j]);
    shape.joints.parents.push_back(kept_ancestor(before.parents[j]));  // renumbered below
    if (!shape.joint_names.empty()) names.push_back(shape.joint_names[j]);
  }
  for (int& parent : shape.joints.parents) parent = parent < 0 ? -1 : place[at(parent)];
  shape.joint_names = std::move(names);
  change_rows(shape.skin, [&](std::vector<Influence> row) {
    for (Influence& influence : row) influence.joint = place[at(kept_ancestor(influence.joint))];
    return row;
  });
  return shape;
}

io::RiggedShape with_blurred_weights(io::RiggedShape shape, int rounds) {
  if (!shape.has_skin() || !shape.has_surface()) throw InputError(shape.file, "", "no weights on a surface to blur");
  std::vector<std::vector<std::int32_t>> ring(shape.mesh.vertices.size());
  for (std::size_t v = 0; v < ring.size(); ++v) ring[v].push_back(static_cast<std::int32_t>(v));
  for (const Triangle& face : shape.mesh.faces) {
    for (int corner = 0; corner < 3; ++corner) {
      for (int other = 1; other < 3; ++other) ring[at(face[at(corner)])].push_back(face[at((corner + other) % 3)]);
    }
  }
  for (auto& neighbours : ring) {
    std::sort(neighbours.begin(), neighbours.end());
    neighbours.erase(std::unique(neighbours.begin(), neighbours.end()), neighbours.end());
  }
  for (int round = 0; round < rounds; ++round) {
    SkinWeights blurred;
    for (const auto& neighbours : ring) {
      std::vector<Influence> row;
      for (const std::int32_t v : neighbours) {
        const auto vertex = static_cast<std::size_t>(v);
        row.insert(row.end(), shape.skin.row(vertex), shape.skin.row(vertex) + shape.skin.row_size(vertex));
      }
      blurred.append_row(std::move(row));
    }
    shape.skin = std::move(blurred);
  }
  return shape;
}

io::RiggedShape with_random_placement(io::RiggedShape shape, std::uint64_t seed) {
  Rng rng(seed, "placement");
  Eigen::Quaterniond rotation(rng.normal(), rng.normal(), rng.normal(), rng.normal());
  metrics::Similarity placement;
  placement.rotation = rotation.normalized().toRotationMatrix();
  placement.scale = 0.2 * std::pow(25.0, rng.uniform());
  const double size = std::max(extent(shape.joints), 1e-6);
  for (int axis = 0; axis < 3; ++axis) placement.translation[axis] = size * rng.uniform(-3.0, 3.0);
  return metrics::transformed(placement, std::move(shape));
}

const std::vector<Perturbation>& perturbations() {
  static const std::vector<Perturbation> kAll = {
      {"joint inserted mid-bone", with_inserted_joint, expectations("+00++?+??")},
      {"branch duplicated 0.1 % away", [](io::RiggedShape shape) { return with_duplicated_branch(std::move(shape)); },
       expectations("000++?+??")},
      {"subtree hung elsewhere", with_reparented_subtree, expectations("0?+0++?0+")},
      {"10 % of joints dropped", [](io::RiggedShape shape) { return with_dropped_joints(std::move(shape)); },
       expectations("+??++++++")},
      {"weights blurred", [](io::RiggedShape shape) { return with_blurred_weights(std::move(shape)); },
       expectations("0000000++")},
  };
  return kAll;
}

anigen::Table self_evaluation(const std::vector<io::RiggedShape>& shapes, const PairSettings& settings) {
  anigen::Table table;
  table.columns = {"shape",     "joints",         "itself, largest", "of",  "moved: skeleton", "of",
                   "moved: GW", "moved: skin l1", "moved: Chamfer",  "ICP", "seconds"};
  table.rows.resize(shapes.size());
  Progress progress("shapes against themselves", shapes.size(), "shapes");
  parallel_for(shapes.size(), [&](std::size_t i) {
    const io::RiggedShape& shape = shapes[i];
    try {
      const PairResult itself = evaluate_pair(shape, shape, settings);
      const PairResult moved = evaluate_pair(with_random_placement(shape, i), shape, settings);
      const Largest exact = largest(itself, false), off = largest(moved, true);
      table.rows[i] = {shape.id,
                       std::to_string(shape.joints.size()),
                       scientific(exact.value),
                       exact.key,
                       scientific(off.value),
                       off.key,
                       scientific(moved.value("gromov_wasserstein")),
                       scientific(moved.value("skin_l1")),
                       scientific(moved.value("surface_chamfer")),
                       scientific(moved.value("icp_rmse")),
                       anigen::fixed(moved.value("seconds"), 2)};
    } catch (const InputError& error) {
      table.rows[i] = {shape.id, std::to_string(shape.joints.size()), error.what(), "", "", "", "", "", "", "", ""};
    }
    progress.advance();
  });
  return table;
}

MistakeResults evaluate_mistakes(const std::vector<io::RiggedShape>& shapes) {
  const auto& mistakes = perturbations();
  MistakeResults results(mistakes.size(), std::vector<PairResult>(shapes.size()));
  Progress progress("mistakes", mistakes.size() * shapes.size(), "pairs");
  parallel_for(mistakes.size() * shapes.size(), [&](std::size_t i) {
    PairResult& result = results[i / shapes.size()][i % shapes.size()];
    const io::RiggedShape& shape = shapes[i % shapes.size()];
    try {
      result = evaluate_pair(mistakes[i / shapes.size()].apply(shape), shape, unaligned());
    } catch (const InputError& error) {
      result.failure = error.what();
    }
    progress.advance();
  });
  return results;
}

anigen::Table sensitivity(const MistakeResults& results) {
  anigen::Table table;
  table.columns = {"mistake", "metric", "expected", "median", "smallest", "largest", "held on"};
  const auto& mistakes = perturbations();
  for (std::size_t p = 0; p < mistakes.size(); ++p) {
    for (const auto& [key, expected] : mistakes[p].expected) {
      const MetricInfo& metric = *find_metric(key);
      std::vector<double> values;
      std::size_t held = 0;
      for (const PairResult& result : results[p]) {
        const double value = loss(result, metric);
        if (!std::isfinite(value)) continue;
        values.push_back(value);
        held += (std::abs(value) < kStudyZero) == (expected == Expected::kZero) ? 1u : 0u;
      }
      if (values.empty()) continue;
      const auto [low, high] = std::minmax_element(values.begin(), values.end());
      const std::string name = metric.better == Better::kHigher ? "1 − " + key : key;
      table.rows.push_back(
          {mistakes[p].name, name, word(expected), anigen::fixed(median(values), 5), anigen::fixed(*low, 5),
           anigen::fixed(*high, 5),
           expected == Expected::kOpen ? "" : std::to_string(held) + " of " + std::to_string(values.size())});
    }
  }
  return table;
}

anigen::Table conventions(const MistakeResults& results) {
  anigen::Table table;
  table.columns = {"mistake", "convention", "J2J", "J2B", "B2B", "J2J / paper", "J2B / paper", "B2B / paper"};
  const auto& mistakes = perturbations();
  for (std::size_t p = 0; p < mistakes.size(); ++p) {
    double paper[3] = {0, 0, 0};
    for (const std::string prefix : {"", "rignet.", "unirig.", "puppeteer."}) {
      std::vector<std::string> row = {mistakes[p].name, prefix.empty() ? "paper" : prefix.substr(0, prefix.size() - 1)};
      std::vector<std::string> ratios;
      int column = 0;
      for (const char* key : {"j2j", "j2b", "b2b"}) {
        std::vector<double> values;
        for (const PairResult& result : results[p]) {
          const double value = result.value(prefix + key);
          if (std::isfinite(value)) values.push_back(value);
        }
        const double mean = summarize(values).mean;
        if (prefix.empty()) paper[column] = mean;
        row.push_back(anigen::fixed(mean, 5));
        ratios.push_back(paper[column] > 1e-9 ? anigen::fixed(mean / paper[column], 2) : "–");
        ++column;
      }
      row.insert(row.end(), ratios.begin(), ratios.end());
      // Blurred weights leave every skeleton metric at zero: nothing to compare.
      if (paper[0] > 0 || paper[1] > 0 || paper[2] > 0) table.rows.push_back(std::move(row));
    }
  }
  return table;
}

anigen::Table degenerate_inputs(const io::RiggedShape& shape) {
  anigen::Table table;
  table.columns = {"prediction", "what becomes of it"};
  PairSettings settings = unaligned();
  settings.groups.insert({"surface", "anymate"});
  settings.surface_samples = 1000;
  const auto add = [&](const std::string& name, io::RiggedShape changed) {
    std::string text;
    try {
      const PairResult result = evaluate_pair(changed, shape, settings);
      text = "j2j " + anigen::fixed(result.value("j2j")) + ", W " + anigen::fixed(result.value("wasserstein")) +
             ", GW " + anigen::fixed(result.value("gromov_wasserstein")) + ", skin l1 " +
             anigen::fixed(result.value("skin_l1")) + ", Chamfer " + anigen::fixed(result.value("surface_chamfer"));
      std::vector<std::string> reasons;
      for (const auto& [key, reason] : result.not_computed) {
        if (std::find(reasons.begin(), reasons.end(), reason) == reasons.end() && find_metric(key)->group != "run")
          reasons.push_back(reason);
      }
      for (const std::string& reason : reasons) text += "; " + reason;
    } catch (const InputError& error) {
      text = std::string("error: ") + error.what();
    }
    table.rows.push_back({name, text});
  };
  const auto one_joint = [](SkinWeights skin) {
    SkinWeights result;
    for (std::size_t v = 0; v < skin.rows(); ++v) result.append_row({{0, 1.0f}});
    return result;
  };

  io::RiggedShape changed = shape;
  changed.joints = {};
  changed.skin = {};
  add("no skeleton", changed);
  changed = shape;
  changed.joints = {{shape.joints.positions[0]}, {-1}};
  changed.skin = one_joint(shape.skin);
  add("a single joint", changed);
  changed = shape;
  for (int& parent : changed.joints.parents) parent = -1;
  add("a forest: every joint a root", changed);
  changed = shape;
  changed.joints.positions[1] = changed.joints.positions[0];
  add("two joints in one place", changed);
  changed = shape;
  changed.joints.positions[1].x() = std::numeric_limits<double>::quiet_NaN();
  add("a joint at NaN", changed);
  changed = shape;
  changed.joints.parents[0] = static_cast<int>(shape.joints.size()) - 1;
  add("a cycle", changed);
  changed = shape;
  changed.skin.offsets.pop_back();
  changed.skin.influences.resize(changed.skin.offsets.back());
  add("weights for one vertex too few", changed);
  changed = shape;
  changed.mesh.faces.clear();
  add("a mesh without faces", changed);
  changed = shape;
  changed.mesh = {};
  changed.skin = {};
  add("no mesh at all", changed);
  return table;
}

}  // namespace anigen::eval
