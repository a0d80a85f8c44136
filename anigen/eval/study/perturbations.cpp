#include "anigen/eval/study/perturbations.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "anigen/asset/mesh.h"
#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/eval/align/similarity.h"

namespace anigen::eval {
namespace {

double extent(const io::JointTree& tree) {
  Box box;
  for (const Eigen::Vector3d& position : tree.positions) box.extend(position);
  return box.longest_side();
}

/// Which joints lie in the subtree of each: bits would do, but skeletons are small.
std::vector<std::vector<int>> subtrees(const io::JointTree& tree) {
  std::vector<std::vector<int>> result(tree.size());
  for (std::size_t j = 0; j < tree.size(); ++j) {
    for (int at = static_cast<int>(j); at >= 0; at = tree.parents[static_cast<std::size_t>(at)])
      result[static_cast<std::size_t>(at)].push_back(static_cast<int>(j));
  }
  return result;
}

/// Top of the largest subtree that holds at most half of the joints; the lowest index of equals.
int branch(const io::RiggedShape& shape, const std::vector<std::vector<int>>& of) {
  int best = -1;
  for (std::size_t j = 0; j < of.size(); ++j) {
    if (shape.joints.parents[j] < 0 || 2 * of[j].size() > of.size()) continue;
    if (best < 0 || of[j].size() > of[static_cast<std::size_t>(best)].size()) best = static_cast<int>(j);
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

}  // namespace

io::RiggedShape with_inserted_joint(io::RiggedShape shape) {
  io::JointTree& tree = shape.joints;
  int child = -1;
  double longest = 0;
  for (std::size_t j = 0; j < tree.size(); ++j) {
    if (tree.parents[j] < 0) continue;
    const double length = (tree.positions[j] - tree.positions[static_cast<std::size_t>(tree.parents[j])]).norm();
    if (length > longest) longest = length, child = static_cast<int>(j);
  }
  if (child < 0) throw InputError(shape.file, "", "no bone to insert a joint into");
  const auto at = static_cast<std::size_t>(child);
  const int parent = tree.parents[at];
  const Eigen::Vector3d middle = 0.5 * (tree.positions[at] + tree.positions[static_cast<std::size_t>(parent)]);
  tree.parents[at] = static_cast<int>(tree.size());
  tree.positions.push_back(middle);
  tree.parents.push_back(parent);
  if (!shape.joint_names.empty()) shape.joint_names.push_back("inserted");
  return shape;
}

io::RiggedShape with_duplicated_branch(io::RiggedShape shape, double offset) {
  io::JointTree& tree = shape.joints;
  const auto of = subtrees(tree);
  const int top = branch(shape, of);
  const Eigen::Vector3d shift = offset * extent(tree) * Eigen::Vector3d::UnitX();
  std::vector<int> copy(tree.size(), -1);
  for (const int j : of[static_cast<std::size_t>(top)]) {
    copy[static_cast<std::size_t>(j)] = static_cast<int>(tree.size());
    tree.positions.push_back(tree.positions[static_cast<std::size_t>(j)] + shift);
    tree.parents.push_back(tree.parents[static_cast<std::size_t>(j)]);
    if (!shape.joint_names.empty())
      shape.joint_names.push_back(shape.joint_names[static_cast<std::size_t>(j)] + "_copy");
  }
  // Inside the branch the copies hang on copies.
  for (const int j : of[static_cast<std::size_t>(top)]) {
    int& parent = tree.parents[static_cast<std::size_t>(copy[static_cast<std::size_t>(j)])];
    if (j != top) parent = copy[static_cast<std::size_t>(parent)];
  }
  change_rows(shape.skin, [&](std::vector<Influence> row) {
    const std::size_t count = row.size();
    for (std::size_t i = 0; i < count; ++i) {
      const int other = copy[static_cast<std::size_t>(row[i].joint)];
      if (other < 0) continue;
      row[i].weight *= 0.5f;
      row.push_back({other, row[i].weight});
    }
    return row;
  });
  return shape;
}

io::RiggedShape with_reparented_subtree(io::RiggedShape shape) {
  io::JointTree& tree = shape.joints;
  const auto of = subtrees(tree);
  const int top = branch(shape, of);
  const auto& inside = of[static_cast<std::size_t>(top)];
  const int parent = tree.parents[static_cast<std::size_t>(top)];
  int farthest = -1;
  double largest = -1;
  for (std::size_t j = 0; j < tree.size(); ++j) {
    const int joint = static_cast<int>(j);
    if (joint == parent || std::find(inside.begin(), inside.end(), joint) != inside.end()) continue;
    const double distance = (tree.positions[j] - tree.positions[static_cast<std::size_t>(parent)]).norm();
    if (distance > largest) largest = distance, farthest = joint;
  }
  if (farthest < 0) throw InputError(shape.file, "", "no other joint to hang a branch on");
  tree.parents[static_cast<std::size_t>(top)] = farthest;
  return shape;
}

io::RiggedShape with_dropped_joints(io::RiggedShape shape, std::uint64_t seed, double fraction) {
  const io::JointTree before = shape.joints;
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
  for (std::size_t i = 0; i < count; ++i) dropped[static_cast<std::size_t>(candidates[order[i]])] = 1;

  const auto kept_ancestor = [&](int joint) {
    while (joint >= 0 && dropped[static_cast<std::size_t>(joint)])
      joint = before.parents[static_cast<std::size_t>(joint)];
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
  for (int& parent : shape.joints.parents) parent = parent < 0 ? -1 : place[static_cast<std::size_t>(parent)];
  shape.joint_names = std::move(names);
  change_rows(shape.skin, [&](std::vector<Influence> row) {
    for (Influence& influence : row) influence.joint = place[static_cast<std::size_t>(kept_ancestor(influence.joint))];
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
      for (int other = 1; other < 3; ++other)
        ring[static_cast<std::size_t>(face[static_cast<std::size_t>(corner)])].push_back(
            face[static_cast<std::size_t>((corner + other) % 3)]);
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
  Similarity placement;
  placement.rotation = rotation.normalized().toRotationMatrix();
  placement.scale = 0.2 * std::pow(25.0, rng.uniform());
  const double size = std::max(extent(shape.joints), 1e-6);
  for (int axis = 0; axis < 3; ++axis) placement.translation[axis] = size * rng.uniform(-3.0, 3.0);
  return transformed(placement, std::move(shape));
}

namespace {

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

}  // namespace

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

}  // namespace anigen::eval
