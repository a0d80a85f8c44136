#include "anigen/lint/name_checks.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cctype>
#include <initializer_list>
#include <map>
#include <set>
#include <vector>

#include "anigen/asset/joint_side.h"
#include "anigen/core/numeric.h"
#include "anigen/core/table.h"
#include "anigen/core/text.h"

namespace anigen::lint {

namespace {

/// Longest name that Blender takes, in bytes.
constexpr std::size_t kLongestName = 63;
/// Distance between the two of a pair, by the size of the mesh, below which they lie in the middle plane.
constexpr double kApart = 0.02;
/// Rise from feet to head over their distance, below which the body lies; the least of 130 rigs of artists is 0.59, a
/// fox.
constexpr double kLeastRise = 0.2;
/// Cosine beyond which left and right contradict the direction that the body faces.
constexpr double kContradiction = -0.5;

/// The joints that a name without its side stands for.
struct Pair {
  std::vector<std::size_t> left, right;
};

double part_of(std::size_t count, std::size_t all) {
  return all == 0 ? 0.0 : static_cast<double>(count) / static_cast<double>(all);
}

/// Joints with weights whose names hold one of these words.
std::vector<std::size_t> named(const WeldedRig& rig, std::initializer_list<const char*> words) {
  std::vector<std::size_t> found;
  for (std::size_t j = 0; j < rig.joint_count(); ++j) {
    const std::string name = lower_case(rig.joint_name(j));
    const bool fits = std::any_of(words.begin(), words.end(),
                                  [&name](const char* word) { return name.find(word) != std::string::npos; });
    if (fits && rig.weights[j] > 0.0) found.push_back(j);
  }
  return found;
}

std::optional<Eigen::Vector3d> middle_of(const WeldedRig& rig, const std::vector<std::size_t>& joints) {
  if (joints.empty()) return std::nullopt;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const std::size_t j : joints) sum += rig.joints[j];
  return sum / static_cast<double>(joints.size());
}

/// Direction that the body faces: along its toes, else from tail to head; nothing where no name tells.
std::optional<Eigen::Vector3d> facing(const WeldedRig& rig) {
  Eigen::Vector3d along = Eigen::Vector3d::Zero();
  for (const std::size_t toe : named(rig, {"toe", "ball"})) {
    const int parent = rig.asset().skeleton.parents[toe];
    if (parent >= 0) along += rig.joints[toe] - rig.joints[at(parent)];
  }
  if (along.isZero()) {
    const auto head = middle_of(rig, named(rig, {"head"})), tail = middle_of(rig, named(rig, {"tail"}));
    if (head && tail) along = *head - *tail;
  }
  along.z() = 0.0;
  if (!(along.norm() > kApart * rig.size)) return std::nullopt;
  return along.normalized();
}

void check_unpaired(const WeldedRig& rig, const std::map<std::string, Pair>& pairs, RigLint& lint) {
  std::vector<std::size_t> unpaired, moving;
  bool left = false, right = false;
  for (const auto& [name, pair] : pairs) {
    left |= !pair.left.empty();
    right |= !pair.right.empty();
    if (!pair.left.empty() && !pair.right.empty()) continue;
    unpaired.insert(unpaired.end(), pair.left.begin(), pair.left.end());
    unpaired.insert(unpaired.end(), pair.right.begin(), pair.right.end());
  }
  // A left hand alone has no right side at all.
  if (!left || !right) unpaired.clear();
  std::sort(unpaired.begin(), unpaired.end());
  for (const std::size_t j : unpaired) {
    if (rig.weights[j] > 0.0) moving.push_back(j);
  }
  lint.figures["unpaired_joints"] = unpaired.size();
  if (unpaired.empty()) return;
  const std::size_t first = moving.empty() ? unpaired.front() : moving.front();
  lint.findings.push_back(
      {"unpaired-names", moving.empty() ? Severity::kNote : Severity::kWarning, unpaired.size(),
       part_of(unpaired.size(), rig.joint_count()), rig.place_of_joint(first),
       "joints of one side have no partner of the other by name: mirroring poses passes them over"});
}

void check_swapped(const WeldedRig& rig, const std::map<std::string, Pair>& pairs, RigLint& lint) {
  std::vector<std::pair<std::size_t, Eigen::Vector3d>> across;  // left joint, from right to left
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const auto& [name, pair] : pairs) {
    if (pair.left.size() != 1 || pair.right.size() != 1) continue;
    const Eigen::Vector3d difference = rig.joints[pair.left[0]] - rig.joints[pair.right[0]];
    if (!(difference.norm() > kApart * rig.size)) continue;
    across.emplace_back(pair.left[0], difference);
    // Every pair has one vote, wide arms no more than narrow hips.
    sum += difference.normalized();
  }
  lint.figures["joint_pairs"] = across.size();
  if (across.empty() || !(sum.norm() > 0.0)) return;
  const Eigen::Vector3d left = sum.normalized();
  std::size_t swapped = 0, worst = 0;
  double farthest = 0.0;
  for (const auto& [joint, difference] : across) {
    const double along = difference.dot(left);
    swapped += along < -kApart * rig.size;
    if (!(along < farthest)) continue;
    farthest = along;
    worst = joint;
  }
  if (swapped > 0) {
    lint.findings.push_back({"swapped-sides", Severity::kWarning, swapped, part_of(swapped, across.size()),
                             rig.place_of_joint(worst),
                             "pairs of joints have left and right the other way round than the other pairs, " +
                                 rig.joint_name(worst) + " among them"});
  }
  const std::optional<Eigen::Vector3d> forward = facing(rig);
  if (!forward) return;
  if (Eigen::Vector3d::UnitZ().cross(*forward).dot(left) < kContradiction) {
    lint.findings.push_back({"mirrored-names", Severity::kNote, across.size(), 1.0,
                             rig.place_of_joint(across.front().first),
                             "joints called left are on the right of the direction that toes or head point to"});
  }
}

void check_upright(const WeldedRig& rig, RigLint& lint) {
  const std::vector<std::size_t> heads = named(rig, {"head"});
  const auto head = middle_of(rig, heads), feet = middle_of(rig, named(rig, {"foot", "feet", "toe"}));
  if (!head || !feet) return;
  const Eigen::Vector3d rise = *head - *feet;
  if (!(rise.norm() > kApart * rig.size)) return;
  const double share = rise.z() / rise.norm();
  lint.figures["head_over_feet"] = share;
  if (share >= kLeastRise) return;
  lint.findings.push_back({"not-upright", Severity::kWarning, 1, part_of(1, rig.joint_count()),
                           rig.place_of_joint(heads.front()),
                           "the head is not above the feet (rise over distance " + significant(share, 2) +
                               "): the up axis of the file may be wrong"});
}

}  // namespace

void check_names(const Skeleton& skeleton, RigLint& lint) {
  const auto place = [&skeleton](std::size_t j) {
    const bool has_place = j < skeleton.bind.size();
    return Place{"joint", j, skeleton.names[j],
                 has_place ? Eigen::Vector3d(skeleton.bind[j].topRightCorner<3, 1>()) : Eigen::Vector3d::Zero()};
  };
  std::vector<std::size_t> empty, repeated, refused;
  std::set<std::string> known;
  for (std::size_t j = 0; j < skeleton.names.size(); ++j) {
    const std::string& name = skeleton.names[j];
    if (name.empty()) {
      empty.push_back(j);
      continue;
    }
    if (!known.insert(name).second) repeated.push_back(j);
    const bool odd = std::any_of(name.begin(), name.end(), [](char c) {
      return std::iscntrl(static_cast<unsigned char>(c)) != 0 || c == '/' || c == '\\';
    });
    if (odd || name.front() == ' ' || name.back() == ' ' || name.size() > kLongestName) refused.push_back(j);
  }
  const auto report = [&](const std::vector<std::size_t>& joints, const char* code, Severity severity,
                          const std::string& sentence) {
    if (joints.empty()) return;
    lint.findings.push_back({code, severity, joints.size(), part_of(joints.size(), skeleton.names.size()),
                             place(joints.front()), sentence});
  };
  report(empty, "empty-names", Severity::kError, "joints have no name: animations of other files cannot find them");
  report(repeated, "repeated-names", Severity::kError, "joints have the name of another one");
  report(refused, "refused-names", Severity::kWarning,
         "names hold a slash or a control character, begin or end with a blank, or are longer than " +
             std::to_string(kLongestName) + " bytes, which engines change or refuse");
}

void check_sides(const WeldedRig& rig, RigLint& lint) {
  std::map<std::string, Pair> pairs;
  for (std::size_t j = 0; j < rig.joint_count(); ++j) {
    const SidedName name = side_of_name(rig.joint_name(j));
    if (name.side != 0) (name.side > 0 ? pairs[name.stem].left : pairs[name.stem].right).push_back(j);
  }
  check_unpaired(rig, pairs, lint);
  check_swapped(rig, pairs, lint);
  check_upright(rig, lint);
}

}  // namespace anigen::lint
