#include "anigen/rigging/pinocchio_template.h"

#include <algorithm>
#include <cctype>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/text.h"

namespace anigen::rigging {

namespace {

constexpr double kCarriedReach = 0.12;  // of the box
constexpr double kFilledShare = 0.9;    // of the box, by joints whose mesh is not known
constexpr double kMirrorTolerance = 0.03;
constexpr double kMiddle = 0.05;
constexpr double kFootShare = 0.1;
constexpr double kFarthestJoint = 10.0;

/// Name of the joint on the other side, for a name that says its side; else empty.
std::string other_side(const std::string& name) {
  std::string lower = lower_case(name);
  for (const bool left : {true, false}) {
    const std::string word = left ? "left" : "right";
    const std::size_t found = lower.find(word);
    if (found != std::string::npos) return lower.replace(found, word.size(), left ? "right" : "left");
  }
  const auto letter = [&](std::size_t i) {
    return i < lower.size() && std::isalpha(static_cast<unsigned char>(lower[i]));
  };
  for (std::size_t i = 0; i < lower.size(); ++i) {
    // A lone letter at an end of the name: "arm.L", "l_arm".
    const bool alone = (i == 0 || !letter(i - 1)) && !letter(i + 1) && lower.size() > 1;
    if (!alone || (lower[i] != 'l' && lower[i] != 'r')) continue;
    lower[i] = lower[i] == 'l' ? 'r' : 'l';
    return lower;
  }
  return "";
}

void find_mirrors(TemplateSkeleton& skeleton) {
  auto& joints = skeleton.joints;
  const auto pair_up = [&](std::size_t a, std::size_t b) {
    joints[a].mirror = static_cast<int>(b);
    joints[b].mirror = static_cast<int>(a);
  };
  for (std::size_t a = 0; a < joints.size(); ++a) {
    const std::string other = other_side(joints[a].name);
    for (std::size_t b = a + 1; b < joints.size() && joints[a].mirror < 0 && !other.empty(); ++b) {
      if (joints[b].mirror < 0 && lower_case(joints[b].name) == other) pair_up(a, b);
    }
  }
  const double plane = joints[0].position.x();
  for (std::size_t a = 0; a < joints.size(); ++a) {
    Eigen::Vector3d image = joints[a].position;
    image.x() = 2.0 * plane - image.x();
    if (joints[a].mirror >= 0 || (image - joints[a].position).norm() < 2.0 * kMirrorTolerance) continue;
    std::size_t best = joints.size();
    double nearest = kMirrorTolerance;
    for (std::size_t b = a + 1; b < joints.size(); ++b) {
      const double d = (joints[b].position - image).norm();
      if (joints[b].mirror >= 0 || !(d < nearest)) continue;
      nearest = d;
      best = b;
    }
    if (best < joints.size()) pair_up(a, best);
  }
}

/// Joints that are not worth a search of their own.
void mark_carried(TemplateSkeleton& skeleton) {
  auto& joints = skeleton.joints;
  const std::size_t n = joints.size();
  std::vector<double> reach(n, 0.0);  // from the parent to the farthest tip
  std::vector<std::vector<std::size_t>> children(n);
  for (std::size_t j = n; j-- > 1;) {
    const auto parent = at(joints[j].parent);
    double below = 0.0;
    for (const std::size_t child : children[j]) below = std::max(below, reach[child]);
    reach[j] = below + (joints[j].position - joints[parent].position).norm();
    children[parent].push_back(j);
  }
  for (std::size_t j = 0; j < n; ++j) {
    std::size_t longest = n;
    for (const std::size_t child : children[j]) {
      if (longest == n || reach[child] >= reach[longest]) longest = child;
    }
    for (const std::size_t child : children[j]) {
      const bool with_parent = j != 0 && joints[j].carried;
      joints[child].carried = with_parent || (child != longest && reach[child] < kCarriedReach);
    }
  }
  const auto kept_children = [&](std::size_t j) {
    std::vector<std::size_t> kept;
    for (const std::size_t child : children[j]) {
      if (!joints[child].carried) kept.push_back(child);
    }
    return kept;
  };
  std::vector<std::size_t> leading;
  std::size_t j = 0;
  for (auto kept = kept_children(0); kept.size() == 1; kept = kept_children(j)) {
    leading.push_back(j);
    j = kept[0];
  }
  if (kept_children(j).empty()) return;  // a lone chain begins at its root
  for (const std::size_t before : leading) joints[before].carried = true;
}

void mark_feet_and_fat(TemplateSkeleton& skeleton) {
  auto& joints = skeleton.joints;
  std::vector<int> kept_children(joints.size(), 0);
  double low = 1e300, high = -1e300, lowest = 1e300;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    low = std::min(low, joints[j].position.z());
    high = std::max(high, joints[j].position.z());
    if (joints[j].carried) continue;
    lowest = std::min(lowest, joints[j].position.z());
    if (j > 0) ++kept_children[at(joints[j].parent)];
  }
  const double plane = joints[0].position.x();
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (joints[j].carried) continue;
    joints[j].foot = kept_children[j] == 0 && joints[j].position.z() <= lowest + kFootShare * (high - low);
    joints[j].fat = kept_children[j] > 1 && std::abs(joints[j].position.x() - plane) < kMiddle;
  }
}

}  // namespace

TemplateSkeleton template_from_skeleton(const Skeleton& skeleton, const Box& box) {
  const std::vector<Eigen::Vector3d> positions = skeleton.positions();
  if (positions.empty()) throw InputError("", "skeleton", "a template needs joints");
  Box around = box;
  double share = 1.0;
  if (box.empty()) {
    for (const Eigen::Vector3d& position : positions) around.extend(position);
    share = kFilledShare;
  }
  if (!(around.longest_side() > 0.0) || !std::isfinite(around.longest_side()))
    throw InputError("", "skeleton", "a template needs joints in different places, and a finite box");
  TemplateSkeleton result;
  result.name = "skeleton";
  result.box = (around.high - around.low) / around.longest_side();
  for (std::size_t j = 0; j < positions.size(); ++j) {
    TemplateJoint joint;
    joint.name = j < skeleton.names.size() ? skeleton.names[j] : "joint_" + std::to_string(j);
    joint.position = share / around.longest_side() * (positions[j] - around.center());
    joint.parent = skeleton.parents[j];
    if (j > 0 && (joint.parent < 0 || at(joint.parent) >= j))
      throw InputError("", "joint " + joint.name, "a template has one root, and parents before children");
    result.joints.push_back(joint);
  }
  mark_carried(result);
  find_mirrors(result);
  mark_feet_and_fat(result);
  check(result);
  return result;
}

void check(const TemplateSkeleton& skeleton) {
  const std::string place = "template " + skeleton.name;
  if (!skeleton.box.allFinite() || !(skeleton.box.minCoeff() >= 0.0) || !(skeleton.box.maxCoeff() > 0.0))
    throw InputError("", place, "its box has no extent");
  std::size_t looked_for = 0;
  for (std::size_t j = 0; j < skeleton.joints.size(); ++j) {
    const TemplateJoint& joint = skeleton.joints[j];
    const auto fail = [&](const std::string& problem) {
      throw InputError("", place, "joint " + std::to_string(j) + " (" + joint.name + ") " + problem);
    };
    if (j == 0 ? joint.parent != -1 : joint.parent < 0 || at(joint.parent) >= j)
      fail("has the parent " + std::to_string(joint.parent) + "; parents come first, and there is one root");
    if (joint.mirror < -1 || joint.mirror >= static_cast<int>(skeleton.joints.size())) fail("mirrors no joint");
    if (!joint.position.allFinite() || joint.position.cwiseAbs().maxCoeff() > kFarthestJoint)
      fail("is not in or near the unit box");
    if (j > 0 && skeleton.joints[at(joint.parent)].guide) fail("hangs on a guide");
    if (j == 0 && joint.guide) fail("is the root and cannot be a guide");
    looked_for += joint.carried ? 0 : 1;
  }
  if (looked_for < 2) throw InputError("", place, "a template needs two joints or more that can be looked for");
}

ReducedSkeleton reduced_skeleton(const TemplateSkeleton& skeleton, double scale) {
  check(skeleton);
  const auto& joints = skeleton.joints;
  std::vector<int> kept_children(joints.size(), 0);
  int root = -1;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (joints[j].carried) continue;
    const int parent = joints[j].parent;
    if (parent >= 0 && !joints[at(parent)].carried) {
      ++kept_children[at(parent)];
    } else if (root >= 0) {
      throw InputError("", "template " + skeleton.name, "the joints that are not carried are several trees");
    } else {
      root = static_cast<int>(j);
    }
  }
  ReducedSkeleton reduced;
  std::vector<int> number(joints.size(), -1);
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const bool is_root = static_cast<int>(j) == root;
    if (joints[j].carried || (!is_root && kept_children[j] == 1)) continue;
    ReducedJoint joint;
    joint.joint = static_cast<int>(j);
    joint.foot = joints[j].foot;
    joint.fat = joints[j].fat;
    joint.leaf = kept_children[j] == 0;
    joint.position = scale * joints[j].position;
    for (int c = static_cast<int>(j); c != root; c = joints[at(c)].parent) {
      if (c != static_cast<int>(j) && number[at(c)] >= 0) break;
      joint.chain.insert(joint.chain.begin(), c);
    }
    if (!is_root) {
      joint.parent = number[at(joints[at(joint.chain.front())].parent)];
      for (const int c : joint.chain) {
        joint.directions.push_back(scale * (joints[at(c)].position - joints[at(joints[at(c)].parent)].position));
        joint.length += joint.directions.back().norm();
        joint.fractions.push_back(joint.length);
      }
      for (std::size_t c = 0; c < joint.chain.size(); ++c) {
        const double even = static_cast<double>(c + 1) / static_cast<double>(joint.chain.size());
        joint.fractions[c] = joint.length > 0.0 ? joint.fractions[c] / joint.length : even;
      }
    }
    number[j] = static_cast<int>(reduced.joints.size());
    reduced.joints.push_back(joint);
  }
  reduced.children.resize(reduced.joints.size());
  for (std::size_t k = 0; k < reduced.joints.size(); ++k) {
    ReducedJoint& joint = reduced.joints[k];
    if (joints[at(joint.joint)].mirror >= 0) joint.mirror = number[at(joints[at(joint.joint)].mirror)];
    if (joint.parent >= 0) reduced.children[at(joint.parent)].push_back(static_cast<int>(k));
  }
  return reduced;
}

}  // namespace anigen::rigging
