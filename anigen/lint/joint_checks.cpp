#include "anigen/lint/joint_checks.h"

#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/core/table.h"
#include "anigen/core/text.h"
#include "anigen/geometry/ray_caster.h"

namespace anigen::lint {

namespace {

/// Joints without weights below each other that make a finding: a single one ends a chain in most rigs.
constexpr std::size_t kFewestDead = 2;
/// Parts of names of joints that are there for animators or for things to hold, not for the surface. Of 130 rigs of
/// artists, those with dead chains have them under one of these, but for one fish whose tail lost its weights.
constexpr std::array<const char*, 18> kHelperWords = {"ctrl",   "control", "ik",    "fk",     "pole",   "target",
                                                      "mch",    "org",     "tweak", "helper", "socket", "slot",
                                                      "attach", "end",     "nub",   "roll",   "root",   "locator"};
/// Distance of a joint from the mesh's box by its diagonal. The largest of a joint with weights on 130 rigs is 0.07.
constexpr double kFarOutside = 0.25;
/// Above this the joint belongs to another place or another unit.
constexpr double kLostOutside = 1.0;
/// Below this share of joints with weights inside the surface the skeleton does not lie in the body.
constexpr double kLeastInside = 0.5;
/// Fewest joints for which that share says something: rings and machines have their joints beside the surface.
constexpr std::size_t kFewestJoints = 6;
/// Scales of a bind matrix along its axes may differ by this factor: shear in files comes to 1.03.
constexpr double kUnevenScale = 1.05;
/// Scales may differ from 1 by this factor before animation tools that drop scale show it.
constexpr double kScaled = 1.01;
/// Sine of the angle between an axis of the root and the nearest axis of the world: 2 degrees.
constexpr double kTilt = 0.035;

/// Words of a name in lower case: "CTRL_IK_foot.L.001", "kneeIK" and "PoleTarget" are cut where a new one begins.
std::vector<std::string> words_of_name(const std::string& name) {
  std::vector<std::string> words(1);
  char before = ' ';
  for (const char c : name) {
    const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
    const bool begins = c >= 'A' && c <= 'Z' && !(before >= 'A' && before <= 'Z');
    if (!letter || begins) words.emplace_back();
    if (letter) words.back() += c;
    before = c;
  }
  for (std::string& word : words) word = lower_case(word);
  return words;
}

bool is_helper(const std::string& name) {
  const std::vector<std::string> words = words_of_name(name);
  return std::any_of(words.begin(), words.end(), [](const std::string& word) {
    return std::any_of(kHelperWords.begin(), kHelperWords.end(),
                       [&word](const char* helper) { return word == helper; });
  });
}

double outside(const Box& box, const Eigen::Vector3d& point) {
  return (box.low - point).cwiseMax(point - box.high).cwiseMax(0.0).norm();
}

/// Directions of the faces and the corners of a cube, a little turned: a ray along an axis runs along edges of boxes.
std::vector<Eigen::Vector3d> fourteen_directions() {
  std::vector<Eigen::Vector3d> directions;
  const Eigen::Vector3d turn(0.031, 0.057, 0.043);
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      for (int z = -1; z <= 1; ++z) {
        const int ones = std::abs(x) + std::abs(y) + std::abs(z);
        if (ones == 1 || ones == 3) directions.push_back((Eigen::Vector3d(x, y, z) + turn).normalized());
      }
    }
  }
  return directions;
}

bool is_enclosed(const geometry::RayCaster& surface, const Eigen::Vector3d& point) {
  static const std::vector<Eigen::Vector3d> directions = fourteen_directions();
  const auto hits = std::count_if(directions.begin(), directions.end(), [&](const Eigen::Vector3d& direction) {
    return surface.first_hit(point, direction).has_value();
  });
  return 2 * static_cast<std::size_t>(hits) >= directions.size();
}

double part_of_joints(std::size_t count, const WeldedRig& rig) {
  return static_cast<double>(count) / static_cast<double>(rig.joint_count());
}

}  // namespace

void check_dead_joints(const WeldedRig& rig, RigLint& lint) {
  std::size_t without = 0, dead = 0, longest = 0;
  for (std::size_t j = 0; j < rig.joint_count(); ++j) {
    without += !(rig.weights[j] > 0.0);
    const int parent = rig.asset().skeleton.parents[j];
    const bool begins = parent < 0 || rig.subtree_weights[at(parent)] > 0.0;
    if (rig.subtree_weights[j] > 0.0 || !begins || rig.subtree_sizes[j] < kFewestDead) continue;
    if (is_helper(rig.joint_name(j))) continue;
    dead += rig.subtree_sizes[j];
    if (longest == 0 || rig.subtree_sizes[j] > rig.subtree_sizes[longest]) longest = j;
  }
  lint.figures["joints_without_weights"] = without;
  lint.figures["dead_joints"] = dead;
  if (dead == 0) return;
  lint.findings.push_back({"dead-joints", Severity::kWarning, dead, part_of_joints(dead, rig),
                           rig.place_of_joint(longest),
                           "joints move nothing, nor do those below them: " + rig.joint_name(longest) + " and " +
                               std::to_string(rig.subtree_sizes[longest] - 1) + " below it"});
}

void check_joint_places(const WeldedRig& rig, RigLint& lint) {
  std::vector<std::size_t> moving;
  for (std::size_t j = 0; j < rig.joint_count(); ++j) {
    if (rig.weights[j] > 0.0) moving.push_back(j);
  }
  std::size_t count = 0, worst = 0;
  double farthest = 0.0;
  for (const std::size_t j : moving) {
    const double distance = outside(rig.box, rig.joints[j]) / rig.size;
    count += distance > kFarOutside;
    if (!(distance > farthest)) continue;
    farthest = distance;
    worst = j;
  }
  lint.figures["farthest_joint_outside"] = farthest;
  if (count > 0) {
    lint.findings.push_back({"joints-outside", farthest > kLostOutside ? Severity::kError : Severity::kWarning, count,
                             part_of_joints(count, rig), rig.place_of_joint(worst),
                             "joints with weights lie outside the mesh's box, " + rig.joint_name(worst) + " by " +
                                 significant(farthest, 3) + " of its diagonal"});
  }
  if (rig.faces.empty() || moving.empty()) return;
  const geometry::RayCaster surface(rig.places, rig.faces);
  std::vector<char> enclosed(moving.size(), 0);
  parallel_for(moving.size(),
               [&](std::size_t i) { enclosed[i] = is_enclosed(surface, rig.joints[moving[i]]) ? char{1} : char{0}; });
  const auto inside = static_cast<std::size_t>(std::count(enclosed.begin(), enclosed.end(), char{1}));
  const double share = static_cast<double>(inside) / static_cast<double>(moving.size());
  lint.figures["joints_inside_share"] = share;
  if (moving.size() < kFewestJoints || share >= kLeastInside) return;
  const std::size_t first =
      moving[static_cast<std::size_t>(std::find(enclosed.begin(), enclosed.end(), char{0}) - enclosed.begin())];
  lint.findings.push_back({"joints-off-body", Severity::kNote, moving.size() - inside,
                           part_of_joints(moving.size() - inside, rig), rig.place_of_joint(first),
                           "the surface does not enclose most joints that have weights"});
}

void check_bind_matrices(const WeldedRig& rig, RigLint& lint) {
  const Skeleton& skeleton = rig.asset().skeleton;
  std::size_t mirrored = 0, first_mirrored = 0, uneven = 0, most_uneven = 0, scaled = 0, most_scaled = 0;
  double worst_ratio = 1.0, worst_scale = 1.0;
  for (std::size_t j = 0; j < rig.joint_count(); ++j) {
    const Eigen::Matrix3d linear = skeleton.bind[j].topLeftCorner<3, 3>();
    const Eigen::Vector3d scales = Eigen::JacobiSVD<Eigen::Matrix3d>(linear).singularValues();
    if (linear.determinant() < 0.0 && mirrored++ == 0) first_mirrored = j;
    const double ratio = scales[0] / scales[2], scale = std::cbrt(scales.prod()), off = std::max(scale, 1.0 / scale);
    uneven += ratio > kUnevenScale;
    scaled += off > kScaled;
    if (ratio > worst_ratio) {
      worst_ratio = ratio;
      most_uneven = j;
    }
    if (off > worst_scale) {
      worst_scale = off;
      most_scaled = j;
    }
  }
  lint.figures["mirrored_binds"] = mirrored;
  lint.figures["largest_bind_scale_ratio"] = worst_ratio;
  if (mirrored > 0) {
    // A left hand made of a right one is mirrored as a whole, and works; a single joint is a slip.
    const bool all = mirrored == rig.joint_count();
    lint.findings.push_back({"mirrored-bind", all ? Severity::kNote : Severity::kWarning, mirrored,
                             part_of_joints(mirrored, rig), rig.place_of_joint(first_mirrored),
                             all ? "all bind matrices mirror: rotations turn the other way in tools that drop scale"
                                 : "bind matrices of some joints mirror, those of others do not"});
  }
  if (uneven > 0) {
    lint.findings.push_back({"uneven-bind-scale", Severity::kNote, uneven, part_of_joints(uneven, rig),
                             rig.place_of_joint(most_uneven),
                             "bind matrices scale by axis, " + rig.joint_name(most_uneven) + " by a ratio of " +
                                 significant(worst_ratio, 3) + "; rotations below shear"});
  }
  if (scaled > 0) {
    lint.findings.push_back(
        {"scaled-bind", Severity::kNote, scaled, part_of_joints(scaled, rig), rig.place_of_joint(most_scaled),
         "bind matrices have a scale other than 1, up to a factor of " + significant(worst_scale, 3) +
             "; motions of other rigs move such joints by the wrong amount"});
  }
  const Eigen::Matrix3d root = skeleton.bind[0].topLeftCorner<3, 3>().colwise().normalized();
  double tilt = 0.0;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    const double along = std::min(1.0, root.col(axis).cwiseAbs().maxCoeff());
    tilt = std::max(tilt, std::sqrt(1.0 - along * along));
  }
  lint.figures["root_tilt_degrees"] = std::asin(std::min(tilt, 1.0)) * 180.0 / kPi;
  if (tilt > kTilt) {
    lint.findings.push_back({"tilted-root", Severity::kNote, 1, part_of_joints(1, rig), rig.place_of_joint(0),
                             "the root's axes are not those of the world, by " +
                                 significant(std::asin(std::min(tilt, 1.0)) * 180.0 / kPi, 3) + " degrees"});
  }
}

}  // namespace anigen::lint
