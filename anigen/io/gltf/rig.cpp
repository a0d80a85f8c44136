#include "anigen/io/gltf/rig.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <functional>
#include <queue>
#include <unordered_set>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/io/gltf/accessors.h"

namespace anigen::io::gltf_import {

FoldedTransform FoldedTransform::operator*(const FoldedTransform& right) const {
  return {scale * right.scale, (rotation * right.rotation).normalized(), *this * right.translation};
}

Transform FoldedTransform::operator*(const Transform& right) const {
  Transform result;
  result.translation = *this * right.translation;
  result.rotation = (rotation * right.rotation).normalized();
  result.scale = scale * right.scale;
  return result;
}

Eigen::Vector3d FoldedTransform::operator*(const Eigen::Vector3d& point) const {
  return scale * (rotation * point) + translation;
}

FoldedTransform y_up_to_z_up() {
  const double half = std::sqrt(0.5);
  return {1.0, Eigen::Quaterniond(half, half, 0.0, 0.0), Eigen::Vector3d::Zero()};
}

namespace {

using Eigen::Matrix4d;

// Nothing when the matrix shears, scales unevenly (by more than 1e-5) or collapses space.
std::optional<FoldedTransform> as_similarity(const Eigen::Matrix4d& matrix) {
  const Eigen::Matrix3d linear = matrix.topLeftCorner<3, 3>();
  const double determinant = linear.determinant();
  const double scale = std::cbrt(determinant);
  if (!(std::abs(scale) > 1e-12) || !std::isfinite(scale)) return std::nullopt;
  // An improper similarity is a negative scale times a rotation, so the quotient is a rotation in both cases.
  const Eigen::Matrix3d rotation = linear / scale;
  if ((rotation.transpose() * rotation - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() > 1e-5) return std::nullopt;
  return FoldedTransform{scale, Eigen::Quaterniond(rotation).normalized(), matrix.topRightCorner<3, 1>()};
}

// Per node, the number of marked nodes at or below it.
std::vector<int> count_below(const Document& document, const std::vector<char>& marked) {
  std::vector<int> count(marked.begin(), marked.end());
  for (auto n = document.top_down.rbegin(); n != document.top_down.rend(); ++n) {
    const int parent = document.nodes[at(*n)].parent;
    if (parent >= 0) count[at(parent)] += count[at(*n)];
  }
  return count;
}

// The deepest node that has all of these at or below it, or -1. @pre none of them is above another
int common_ancestor(const Document& document, const std::vector<int>& nodes) {
  std::vector<char> marked(document.nodes.size(), 0);
  for (const int n : nodes) marked[at(n)] = 1;
  const std::vector<int> below = count_below(document, marked);
  int deepest = -1;
  for (const int n : document.top_down) {  // those with all of them below form one path downwards
    if (below[at(n)] == static_cast<int>(nodes.size())) deepest = n;
  }
  return deepest;
}

// Nodes of the file that become joints.
struct JointChoice {
  std::vector<char> is_joint;   //< per node
  std::vector<char> skin_used;  //< per skin: shown in the scene, or all of its joints are
};

std::vector<char> used_skins(const Document& document) {
  std::vector<char> used(document.skins.size(), 0);
  for (std::size_t s = 0; s < used.size(); ++s) {
    const std::vector<int>& joints = document.skins[s].joints;
    used[s] = std::all_of(joints.begin(), joints.end(), [&](int n) { return document.in_scene[at(n)] != 0; }) ? 1 : 0;
  }
  for (std::size_t n = 0; n < document.nodes.size(); ++n) {
    const Node& node = document.nodes[n];
    if (document.in_scene[n] != 0 && node.mesh >= 0 && node.skin >= 0) used[at(node.skin)] = 1;
  }
  return used;
}

void promote_nodes(const Document& document, const std::vector<char>& moving, std::vector<char>& is_joint,
                   Notes& notes) {
  std::vector<char> rigid(document.nodes.size(), 0);
  for (std::size_t n = 0; n < rigid.size(); ++n) {
    const Node& node = document.nodes[n];
    rigid[n] = document.in_scene[n] != 0 && node.mesh >= 0 && node.skin < 0 ? 1 : 0;
  }
  const std::vector<int> joints_below = count_below(document, is_joint), rigid_below = count_below(document, rigid);
  std::size_t moved = 0, uneven = 0;
  for (std::size_t n = 0; n < rigid.size(); ++n) {
    if (is_joint[n] != 0) continue;
    const bool carries_motion = moving[n] != 0 && (joints_below[n] > 0 || rigid_below[n] > 0);
    const bool cannot_fold = joints_below[n] > 0 && !as_similarity(document.nodes[n].matrix);
    if (!carries_motion && !cannot_fold) continue;
    is_joint[n] = 1;
    ++(carries_motion ? moved : uneven);
  }
  if (moved + uneven == 0) return;
  notes.tally("promoted_node",
              "nodes became joints (" + std::to_string(moved) + " that move joints or meshes, " +
                  std::to_string(uneven) + " with uneven scale or shear above joints)",
              moved + uneven);
}

bool shows_triangles(const Document& document) {
  for (std::size_t n = 0; n < document.nodes.size(); ++n) {
    const int mesh = document.nodes[n].mesh;
    if (mesh < 0 || document.in_scene[n] == 0) continue;
    const std::vector<Primitive>& primitives = document.meshes[at(mesh)].primitives;
    if (std::any_of(primitives.begin(), primitives.end(), [](const Primitive& one) { return one.mode >= 4; }))
      return true;
  }
  return false;
}

// A motion without a mesh: ends of chains often do not move themselves.
void mark_moving_trees(const Document& document, const std::vector<char>& moving, std::vector<char>& is_joint) {
  for (const int n : document.top_down) {
    const int parent = document.nodes[at(n)].parent;
    const bool below = parent >= 0 && is_joint[at(parent)] != 0;
    if (document.in_scene[at(n)] != 0 && (moving[at(n)] != 0 || below)) is_joint[at(n)] = 1;
  }
}

// The joints of every used skin, and promoted: nodes above joints that move or that cannot be folded into a joint
// (uneven scale, shear), and moving nodes that carry meshes without skin. A scene without a skin, where none is
// required, has no joints where it shows triangles; where it does not, they are the nodes that move and all below them.
JointChoice choose_joints(const Document& document, const std::vector<char>& moving, bool require_skin, Notes& notes) {
  if (document.skins.empty() && require_skin)
    throw InputError(document.file, "/skins", "no skin: nothing to animate; export the mesh with its armature");
  JointChoice choice;
  choice.skin_used = used_skins(document);
  choice.is_joint.assign(document.nodes.size(), 0);
  bool any = false;
  for (std::size_t s = 0; s < document.skins.size(); ++s) {
    if (choice.skin_used[s] == 0) continue;
    any = true;
    for (const int n : document.skins[s].joints) choice.is_joint[at(n)] = 1;
  }
  if (!any && require_skin) throw InputError(document.file, "/skins", "no skin in this scene: nothing to animate");
  if (!any && shows_triangles(document)) return choice;
  if (!any) mark_moving_trees(document, moving, choice.is_joint);
  promote_nodes(document, moving, choice.is_joint, notes);
  return choice;
}

// Transforms between the nodes and the joints above them.
struct Hierarchy {
  std::vector<int> tops;                // joints without a joint above
  std::vector<int> joint_above;         // [N] node of the nearest joint strictly above, or -1
  std::vector<FoldedTransform> folded;  // [N] joints: the static nodes between the joint above and this one
  std::vector<Matrix4d> below_joint;    // [N] as in Rig
  std::vector<Matrix4d> world;          // [N]
  std::size_t folded_nodes = 0;
};

Hierarchy walk_down(const Document& document, const std::vector<char>& is_joint) {
  const std::size_t nodes = document.nodes.size();
  const std::vector<int> joints_below = count_below(document, is_joint);
  Hierarchy result;
  result.joint_above.assign(nodes, -1);
  result.folded.resize(nodes);
  result.below_joint.assign(nodes, Matrix4d::Identity());
  result.world.resize(nodes);
  for (const int n : document.top_down) {
    const Node& node = document.nodes[at(n)];
    const int parent = node.parent;
    const bool is_root = parent < 0, under_joint = !is_root && is_joint[at(parent)] != 0;
    result.world[at(n)] = is_root ? node.matrix : Matrix4d(result.world[at(parent)] * node.matrix);
    if (!is_root) result.joint_above[at(n)] = under_joint ? parent : result.joint_above[at(parent)];
    // Of a joint: what comes before it. Of another node: including the node.
    FoldedTransform& folded = result.folded[at(n)];
    if (!is_root && !under_joint) folded = result.folded[at(parent)];
    if (is_joint[at(n)] != 0) {
      if (result.joint_above[at(n)] < 0) result.tops.push_back(n);
      continue;
    }
    result.below_joint[at(n)] =
        is_root || under_joint ? node.matrix : Matrix4d(result.below_joint[at(parent)] * node.matrix);
    if (joints_below[at(n)] == 0) continue;
    if (result.joint_above[at(n)] >= 0) ++result.folded_nodes;
    folded = folded * as_similarity(node.matrix).value();  // choose_joints() made joints of all others
  }
  return result;
}

std::string unique_name(const std::string& wanted, std::size_t joint, std::unordered_set<std::string>& taken) {
  const std::string base = wanted.empty() ? "joint_" + std::to_string(joint) : wanted;
  std::string name = base;
  // Larger steps once the small numbers are used up, so that a file of equal names does not take quadratic time.
  for (std::size_t k = 2; !taken.insert(name).second; k += k < 100 ? 1 : joint) name = base + "_" + std::to_string(k);
  return name;
}

class RigBuilder {
 public:
  RigBuilder(const Document& document, const JointChoice& choice)
      : document_(document), is_joint_(choice.is_joint), hierarchy_(walk_down(document, choice.is_joint)) {
    rig_.skin_used = choice.skin_used;
    rig_.joint_of_node.assign(document.nodes.size(), -1);
  }

  Rig build(Notes& notes) {
    above_tops_ = y_up_to_z_up();
    if (hierarchy_.tops.size() > 1) make_root(notes);
    append_joints();
    rig_.nearest_joint.assign(document_.nodes.size(), -1);
    std::size_t sheared = 0;
    for (std::size_t n = 0; n < document_.nodes.size(); ++n) {
      const int above = hierarchy_.joint_above[n];
      if (is_joint_[n] != 0)
        rig_.nearest_joint[n] = rig_.joint_of_node[n];
      else if (above >= 0)
        rig_.nearest_joint[n] = rig_.joint_of_node[at(above)];
      sheared += is_joint_[n] != 0 && document_.nodes[n].shear > 1e-6 ? 1 : 0;
    }
    rig_.below_joint = std::move(hierarchy_.below_joint);
    notes.tally("duplicate_joint_names", "joints had the name of an earlier one and were given another",
                repeated_names_);
    notes.tally("folded_node", "static nodes between joints were folded into them", hierarchy_.folded_nodes);
    notes.tally("sheared_joint", "joints have a sheared matrix; they rest in the nearest pose without shear", sheared);
    return std::move(rig_);
  }

 private:
  int append(const std::string& name, int parent, const FoldedTransform& prefix, const Transform& local) {
    const std::size_t joint = rig_.skeleton.size();
    repeated_names_ += !name.empty() && taken_.count(name) > 0 ? 1 : 0;
    rig_.skeleton.names.push_back(unique_name(name, joint, taken_));
    rig_.skeleton.parents.push_back(parent);
    rig_.skeleton.rest.push_back(prefix * local);
    rig_.prefix.push_back(prefix);
    return static_cast<int>(joint);
  }

  // One root where the nodes of all roots branch, so that the tree stays compact around the character.
  void make_root(Notes& notes) {
    const int ancestor = common_ancestor(document_, hierarchy_.tops);
    Eigen::Vector3d position = Eigen::Vector3d::Zero();
    if (ancestor >= 0) position = hierarchy_.world[at(ancestor)].topRightCorner<3, 1>();
    FoldedTransform root = above_tops_;
    root.translation = root * position;
    // A joint of the file keeps its own name.
    const bool is_taken = std::any_of(document_.nodes.begin(), document_.nodes.end(),
                                      [](const Node& node) { return node.name == "root"; });
    append(is_taken ? "common_root" : "root", -1, root, Transform());
    above_tops_ = {};
    above_tops_.translation = -position;
    notes.tally("several_roots", "joint roots were put under one made root joint", hierarchy_.tops.size());
  }

  // Parents before children, otherwise in the order of the file.
  void append_joints() {
    std::vector<std::vector<int>> children(document_.nodes.size());
    for (std::size_t n = 0; n < children.size(); ++n) {
      if (is_joint_[n] != 0 && hierarchy_.joint_above[n] >= 0)
        children[at(hierarchy_.joint_above[n])].push_back(static_cast<int>(n));
    }
    const std::vector<int>& tops = hierarchy_.tops;
    std::priority_queue<int, std::vector<int>, std::greater<int>> ready(tops.begin(), tops.end());
    while (!ready.empty()) {
      const int n = ready.top();
      ready.pop();
      const int above = hierarchy_.joint_above[at(n)];
      const int parent = above >= 0 ? rig_.joint_of_node[at(above)] : (tops.size() > 1 ? 0 : -1);
      const FoldedTransform& folded = hierarchy_.folded[at(n)];
      const Node& node = document_.nodes[at(n)];
      rig_.joint_of_node[at(n)] = append(node.name, parent, above >= 0 ? folded : above_tops_ * folded, node.local);
      for (const int child : children[at(n)]) ready.push(child);
    }
  }

  const Document& document_;
  const std::vector<char>& is_joint_;
  Hierarchy hierarchy_;
  FoldedTransform above_tops_;
  std::unordered_set<std::string> taken_;
  std::size_t repeated_names_ = 0;
  Rig rig_;
};

}  // namespace

Rig build_rig(const Document& document, const std::vector<char>& moving, const ImportOptions& options, Notes& notes) {
  const JointChoice choice = choose_joints(document, moving, options.require_rig, notes);
  const auto joints = static_cast<std::size_t>(std::count(choice.is_joint.begin(), choice.is_joint.end(), 1));
  if (joints > options.max_joints) {
    throw InputError(document.file, "/skins",
                     std::to_string(joints) + " joints exceed the limit of " + std::to_string(options.max_joints));
  }
  return RigBuilder(document, choice).build(notes);
}

namespace {

// Inverse bind matrices are 32-bit floats: a ratio of singular values below their noise means a collapsed axis.
bool is_usable(const Matrix4d& matrix) {
  if (!matrix.allFinite()) return false;
  const Eigen::Matrix3d linear = matrix.topLeftCorner<3, 3>();
  if (!(linear.norm() < 1e15)) return false;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> squares(linear.transpose() * linear, Eigen::EigenvaluesOnly);
  const double least = squares.eigenvalues()[0], most = squares.eigenvalues()[2];
  return least > 1e-12 * most && least > 1e-30;
}

std::vector<Matrix4d> read_inverse_binds(const Document& document, const Skin& skin, Notes& notes) {
  std::vector<Matrix4d> matrices(skin.joints.size(), Matrix4d::Identity());
  if (skin.inverse_bind_accessor < 0) {
    notes.tally("missing_inverse_bind", "skins have no inverse bind matrices: identities stand for them");
    return matrices;
  }
  const std::vector<double> numbers = read_doubles(document, skin.inverse_bind_accessor, matrices.size());
  for (std::size_t k = 0; k < matrices.size(); ++k) {
    matrices[k] = Eigen::Map<const Matrix4d>(numbers.data() + 16 * k);
    if (matrices[k].allFinite() && (matrices[k].row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff() > 1e-3)
      notes.tally("repaired_inverse_bind", "inverse bind matrices had a last row other than 0 0 0 1");
    matrices[k].row(3) = Eigen::RowVector4d(0, 0, 0, 1);
  }
  return matrices;
}

// A joint can rest at scale 0 (hidden); the bind pose must stay invertible.
Matrix4d invertible_rest(const Transform& rest) {
  Transform local = rest;
  for (double& s : local.scale) {
    if (!(std::abs(s) > 1e-9)) s = 1.0;
  }
  return local.matrix();
}

class BindPose {
 public:
  explicit BindPose(const Skeleton& skeleton) : skeleton_(skeleton), bind_(skeleton.size()), is_set_(skeleton.size()) {}

  bool is_set(int joint) const { return is_set_[at(joint)]; }
  const Matrix4d& operator[](int joint) const { return bind_[at(joint)]; }
  void set(int joint, const Matrix4d& bind) {
    bind_[at(joint)] = bind;
    bind_[at(joint)].row(3) = Eigen::RowVector4d(0, 0, 0, 1);
    is_set_[at(joint)] = true;
  }
  // C of the nearest joint above that is set, followed by the rest transforms down to this one.
  Matrix4d from_parents(int joint) const {
    Matrix4d result = invertible_rest(skeleton_.rest[at(joint)]);
    for (int j = skeleton_.parents[at(joint)]; j >= 0; j = skeleton_.parents[at(j)]) {
      if (is_set(j)) return bind_[at(j)] * result;
      result = invertible_rest(skeleton_.rest[at(j)]) * result;
    }
    return result;
  }
  std::vector<Matrix4d> take() { return std::move(bind_); }

 private:
  const Skeleton& skeleton_;
  std::vector<Matrix4d> bind_;
  std::vector<bool> is_set_;
};

// A of one skin. Entries in the order of the rig come parents first.
Matrix4d skin_to_bind(const BindPose& pose, const std::vector<int>& joints, const std::vector<Matrix4d>& inverse,
                      const std::vector<char>& usable) {
  std::size_t top = joints.size(), shared = joints.size();
  for (std::size_t k = 0; k < joints.size(); ++k) {
    if (usable[k] == 0) continue;
    if (top == joints.size() || joints[k] < joints[top]) top = k;
    if (pose.is_set(joints[k]) && (shared == joints.size() || joints[k] < joints[shared])) shared = k;
  }
  if (shared < joints.size()) return pose[joints[shared]] * inverse[shared];
  return pose.from_parents(joints[top]) * inverse[top];
}

void note_rest_difference(const Skeleton& skeleton, Notes& notes) {
  const std::vector<Matrix4d> rest = forward_kinematics(skeleton.parents, skeleton.rest);
  Box box;
  for (const Eigen::Vector3d& p : skeleton.positions()) box.extend(p);
  std::size_t differ = 0;
  for (std::size_t j = 0; j < rest.size(); ++j) {
    const Matrix4d difference = rest[j] - skeleton.bind[j];
    const double moved = difference.topRightCorner<3, 1>().norm();
    const double turned = difference.topLeftCorner<3, 3>().norm() / skeleton.bind[j].topLeftCorner<3, 3>().norm();
    const double noise = 1e-9 * skeleton.bind[j].topRightCorner<3, 1>().norm();
    if (moved > 1e-3 * box.diagonal() + noise || turned > 1e-3) ++differ;
  }
  notes.tally("rest_pose_differs", "joints rest elsewhere than in the bind pose", differ);
}

}  // namespace

std::vector<SkinBinding> bind_skins(const Document& document, Rig& rig, Notes& notes) {
  std::vector<SkinBinding> bindings(document.skins.size());
  std::vector<std::vector<Matrix4d>> inverses(document.skins.size());
  std::vector<std::vector<char>> usable(document.skins.size());
  BindPose pose(rig.skeleton);
  for (std::size_t s = 0; s < bindings.size(); ++s) {
    if (rig.skin_used[s] == 0) continue;
    const Skin& skin = document.skins[s];
    SkinBinding& binding = bindings[s];
    for (const int node : skin.joints) binding.joints.push_back(rig.joint_of_node[at(node)]);
    inverses[s] = read_inverse_binds(document, skin, notes);
    for (const Matrix4d& matrix : inverses[s]) usable[s].push_back(is_usable(matrix) ? 1 : 0);
    const auto bad = static_cast<std::size_t>(std::count(usable[s].begin(), usable[s].end(), 0));
    if (bad == usable[s].size()) {
      throw InputError(document.file, skin.pointer + "/inverseBindMatrices",
                       "none of the inverse bind matrices can be inverted");
    }
    notes.tally("repaired_inverse_bind", "inverse bind matrices could not be inverted and follow the parent joint",
                bad);
    binding.to_bind = skin_to_bind(pose, binding.joints, inverses[s], usable[s]);
    for (std::size_t k = 0; k < skin.joints.size(); ++k) {
      if (usable[s][k] != 0 && !pose.is_set(binding.joints[k]))
        pose.set(binding.joints[k], binding.to_bind * inverses[s][k].inverse());
    }
  }
  for (int j = 0; j < static_cast<int>(rig.skeleton.size()); ++j) {
    if (!pose.is_set(j)) pose.set(j, pose.from_parents(j));
  }
  for (std::size_t s = 0; s < bindings.size(); ++s) {
    SkinBinding& binding = bindings[s];
    double largest = 0.0;
    for (std::size_t k = 0; k < binding.joints.size(); ++k) {
      Matrix4d deviation = Matrix4d::Zero();
      if (usable[s][k] != 0) deviation = pose[binding.joints[k]] * inverses[s][k] - binding.to_bind;
      largest = std::max(largest, deviation.norm() / binding.to_bind.norm());
      binding.deviation.push_back(deviation);
    }
    if (largest < 1e-9) binding.deviation.clear();
  }
  rig.skeleton.bind = pose.take();
  for (const Matrix4d& bind : rig.skeleton.bind) {
    if (!bind.allFinite()) throw InputError(document.file, "/skins", "the bind pose is not finite");
  }
  note_rest_difference(rig.skeleton, notes);
  return bindings;
}

}  // namespace anigen::io::gltf_import
