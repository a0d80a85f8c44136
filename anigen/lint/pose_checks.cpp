#include "anigen/lint/pose_checks.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/core/random.h"
#include "anigen/core/table.h"
#include "anigen/geometry/crossings.h"
#include "anigen/metrics/shell_gaps.h"

namespace anigen::lint {

namespace {

/// Turn of a joint: elbows and knees go farther, but about one axis; across all joints and axes this much is common.
constexpr double kTurn = 45.0 * kPi / 180.0;
/// Ratio of an edge's lengths above which skin tears to the eye.
constexpr double kStretch = 3.0;
/// Edges shorter than this part of the size are not measured: they stretch by any ratio without being seen.
constexpr double kShortestEdge = 1e-4;
/// Faces below this area, by the squared size, have no normal to speak of.
constexpr double kSmallestArea = 1e-10;
/// Shares of a joint that count as none and all.
constexpr double kUnmoved = 1e-4, kMoved = 1.0 - 1e-4;
// Limits of shares in the worst pose, set on 130 rigs of artists. Stretched: at most 0.16, dinosaurs whose legs hang on
// inverse kinematics and stay behind when the body turns. Inverted: at most 0.13, the same. New crossings (60 rigs): at
// most 0.12, the same.
/// Share of stretched faces that is a finding, and that is an error.
constexpr double kManyStretched = 0.2, kMostStretched = 0.5;
/// Share of inverted faces that is a finding.
constexpr double kManyInverted = 0.2;
/// Share of faces with a new crossing that is a finding.
constexpr double kManyCrossed = 0.15;
/// Faces of a mesh below which shares say nothing: test files have two.
constexpr std::size_t kFewestFaces = 20;
/// Work of stretch, in faces times poses: half a second on one core.
constexpr std::size_t kStretchWork = 20'000'000;
/// Work of gaps, in faces and pairs of shells times poses: about a second on one core.
constexpr std::size_t kGapWork = 20'000'000, kFacesOfAPair = 50;
/// Work of crossings, in faces times poses, each with a BVH of its own: about a second on two cores; and poses at most.
constexpr std::size_t kCrossingWork = 600'000, kCrossingPoses = 24;

/// Joints that turn something against something else.
std::vector<std::size_t> turning_joints(const WeldedRig& rig) {
  std::vector<std::size_t> joints;
  for (std::size_t j = 1; j < rig.joint_count(); ++j) {
    if (rig.subtree_weights[j] > 0.0) joints.push_back(j);
  }
  return joints;
}

/// Some of the joints, drawn by the seed, in their order.
std::vector<std::size_t> some_of(std::vector<std::size_t> joints, std::size_t most, std::uint64_t seed) {
  if (joints.size() <= most) return joints;
  const std::vector<std::size_t> order = Rng(seed, "lint_poses").permutation(joints.size());
  std::vector<std::size_t> chosen;
  for (std::size_t i = 0; i < most; ++i) chosen.push_back(joints[order[i]]);
  std::sort(chosen.begin(), chosen.end());
  return chosen;
}

/// The joints that move the most against the rest, heaviest first: there surfaces meet.
std::vector<std::size_t> heaviest_of(const WeldedRig& rig, std::vector<std::size_t> joints, std::size_t most) {
  const auto against = [&rig](std::size_t j) {
    return std::min(rig.subtree_weights[j], rig.subtree_weights[0] - rig.subtree_weights[j]);
  };
  std::stable_sort(joints.begin(), joints.end(), [&](std::size_t a, std::size_t b) { return against(a) > against(b); });
  joints.resize(std::min(most, joints.size()));
  return joints;
}

/// Faces of one pose.
struct PoseFaces {
  std::vector<std::size_t> stretched, inverted;
  double longest = 1.0;  ///< ratio of edge lengths
};

/// The face's three places.
using Corners = std::array<Eigen::Vector3d, 3>;

Corners corners_of(const std::vector<Eigen::Vector3f>& places, const Triangle& face) {
  return {places[at(face[0])].cast<double>(), places[at(face[1])].cast<double>(), places[at(face[2])].cast<double>()};
}

Eigen::Vector3d double_area(const Corners& c) { return (c[1] - c[0]).cross(c[2] - c[0]); }

double longest_ratio(const Corners& rest, const Corners& posed, double shortest) {
  double longest = 0.0;
  for (std::size_t k = 0; k < 3; ++k) {
    const double before = (rest[(k + 1) % 3] - rest[k]).norm();
    if (before > shortest) longest = std::max(longest, (posed[(k + 1) % 3] - posed[k]).norm() / before);
  }
  return longest;
}

/// Faces that a joint moves in part: only these change their shape.
std::vector<std::size_t> faces_between(const WeldedRig& rig, const std::vector<double>& shares) {
  std::vector<std::size_t> between;
  for (std::size_t f = 0; f < rig.faces.size(); ++f) {
    const Triangle& face = rig.faces[f];
    const auto [least, most] = std::minmax({shares[at(face[0])], shares[at(face[1])], shares[at(face[2])]});
    if (most > kUnmoved && least < kMoved) between.push_back(f);
  }
  return between;
}

PoseFaces measured(const WeldedRig& rig, const JointTurn& turn, const std::vector<double>& shares,
                   const std::vector<std::size_t>& between) {
  const std::vector<Eigen::Vector3f> posed = turned_places(rig, turn, shares);
  PoseFaces result;
  for (const std::size_t f : between) {
    const Triangle& face = rig.faces[f];
    const Corners before = corners_of(rig.places, face), after = corners_of(posed, face);
    const double ratio = longest_ratio(before, after, kShortestEdge * rig.size);
    result.longest = std::max(result.longest, ratio);
    if (ratio > kStretch) result.stretched.push_back(f);
    const Eigen::Vector3d normal = double_area(before);
    if (!(normal.norm() > kSmallestArea * rig.size * rig.size)) continue;
    const double share = (shares[at(face[0])] + shares[at(face[1])] + shares[at(face[2])]) / 3.0;
    const Eigen::Vector3d expected = Eigen::AngleAxisd(share * turn.angle, turn.axis) * normal;
    if (double_area(after).dot(expected) < 0.0) result.inverted.push_back(f);
  }
  return result;
}

/// The pose with the most faces of one kind.
struct Worst {
  std::vector<std::size_t> faces;
  std::size_t joint = 0;

  void take(const std::vector<std::size_t>& others, std::size_t of) {
    if (others.size() <= faces.size()) return;
    faces = others;
    joint = of;
  }
};

double part_of_faces(std::size_t count, const WeldedRig& rig) {
  return rig.faces.empty() ? 0.0 : static_cast<double>(count) / static_cast<double>(rig.faces.size());
}

/// @return the worst of all these poses; slot i of `of_joint` holds those of joint i
Worst worst_of(const std::vector<Worst>& of_joint) {
  Worst worst;
  for (const Worst& one : of_joint) worst.take(one.faces, one.joint);
  return worst;
}

void report(const WeldedRig& rig, const Worst& worst, const std::string& code, Severity severity,
            const std::string& sentence, RigLint& lint) {
  lint.findings.push_back({code, severity, worst.faces.size(), part_of_faces(worst.faces.size(), rig),
                           rig.place_of_face(worst.faces.front(), worst.joint),
                           sentence + " when " + rig.joint_name(worst.joint) + " turns by 45 degrees"});
}

void check_shape(const WeldedRig& rig, std::uint64_t seed, RigLint& lint) {
  const std::size_t affordable = std::max<std::size_t>(1, kStretchWork / (4 * rig.faces.size()));
  const std::vector<std::size_t> joints = some_of(turning_joints(rig), affordable, seed);
  std::vector<Worst> stretched(joints.size()), inverted(joints.size());
  std::vector<double> longest(joints.size(), 1.0);
  parallel_for(joints.size(), [&](std::size_t i) {
    const std::vector<double> shares = shares_moved(rig, joints[i]);
    const std::vector<std::size_t> between = faces_between(rig, shares);
    if (between.empty()) return;
    for (const JointTurn& turn : turns_of_joint(rig, joints[i])) {
      const PoseFaces faces = measured(rig, turn, shares, between);
      stretched[i].take(faces.stretched, joints[i]);
      inverted[i].take(faces.inverted, joints[i]);
      longest[i] = std::max(longest[i], faces.longest);
    }
  });
  const Worst most_stretched = worst_of(stretched), most_inverted = worst_of(inverted);
  const double stretched_share = part_of_faces(most_stretched.faces.size(), rig);
  const double inverted_share = part_of_faces(most_inverted.faces.size(), rig);
  lint.figures["posed_joints"] = joints.size();
  lint.figures["longest_edge_ratio"] = joints.empty() ? 1.0 : *std::max_element(longest.begin(), longest.end());
  lint.figures["stretched_share"] = stretched_share;
  lint.figures["inverted_share"] = inverted_share;
  if (rig.faces.size() < kFewestFaces) return;
  if (stretched_share > kManyStretched) {
    report(rig, most_stretched, "stretched-faces",
           stretched_share > kMostStretched ? Severity::kError : Severity::kWarning,
           "faces have an edge more than 3 times as long", lint);
  }
  if (inverted_share > kManyInverted)
    report(rig, most_inverted, "inverted-faces", Severity::kWarning, "faces turn inside out", lint);
}

/// Largest growth of the distance of each pair of shells that touch at rest, over all poses.
void check_gaps(const WeldedRig& rig, std::uint64_t seed, RigLint& lint) {
  const metrics::ShellGaps gaps(rig.places, rig.faces);
  const std::size_t pairs = gaps.pairs().size();
  std::vector<double> worst(pairs, 0.0);
  if (pairs > 0) {
    const std::size_t work_of_joint = 4 * (rig.faces.size() + kFacesOfAPair * pairs);
    const std::vector<std::size_t> joints =
        some_of(turning_joints(rig), std::max<std::size_t>(1, kGapWork / work_of_joint), seed);
    std::vector<std::vector<double>> of_joint(joints.size());
    parallel_for(joints.size(), [&](std::size_t i) {
      const std::vector<double> shares = shares_moved(rig, joints[i]);
      std::vector<double>& own = of_joint[i] = std::vector<double>(pairs, 0.0);
      for (const JointTurn& turn : turns_of_joint(rig, joints[i])) {
        const std::vector<double> grown = gaps.growth(turned_places(rig, turn, shares));
        for (std::size_t p = 0; p < pairs; ++p) own[p] = std::max(own[p], grown[p]);
      }
    });
    for (const std::vector<double>& own : of_joint) {
      for (std::size_t p = 0; p < pairs; ++p) worst[p] = std::max(worst[p], own[p]);
    }
  }
  double sum = 0.0, most = 0.0;
  for (const double growth : worst) {
    sum += growth;
    most = std::max(most, growth);
  }
  lint.figures["touching_shells"] = pairs;
  lint.figures["gap_growth_mean"] = pairs == 0 ? 0.0 : sum / static_cast<double>(pairs);
  lint.figures["gap_growth_max"] = most;
}

void check_crossings(const WeldedRig& rig, RigLint& lint) {
  const std::size_t affordable = std::max<std::size_t>(2, kCrossingWork / rig.faces.size());
  const std::size_t most = std::min(kCrossingPoses, affordable) / 2;
  const geometry::FaceMarks at_rest = geometry::crossed_faces(rig.places, rig.faces, rig.edges);
  Worst worst;
  std::size_t poses = 0;
  for (const std::size_t joint : heaviest_of(rig, turning_joints(rig), most)) {
    const std::vector<double> shares = shares_moved(rig, joint);
    const std::vector<JointTurn> turns = turns_of_joint(rig, joint);
    // To both sides about one axis: the other axis would double the time and shows much the same.
    for (const JointTurn& turn : {turns[0], turns[1]}) {
      const geometry::FaceMarks posed = geometry::crossed_faces(turned_places(rig, turn, shares), rig.faces, rig.edges);
      std::vector<std::size_t> fresh;
      for (std::size_t f = 0; f < posed.size(); ++f) {
        if (posed[f] != 0 && at_rest[f] == 0) fresh.push_back(f);
      }
      worst.take(fresh, joint);
      ++poses;
    }
  }
  const double share = part_of_faces(worst.faces.size(), rig);
  lint.figures["crossed_share_at_rest"] =
      part_of_faces(static_cast<std::size_t>(std::count(at_rest.begin(), at_rest.end(), char{1})), rig);
  lint.figures["crossing_poses"] = poses;
  lint.figures["newly_crossed_share"] = share;
  if (rig.faces.size() < kFewestFaces || !(share > kManyCrossed)) return;
  report(rig, worst, "self-intersections", Severity::kWarning, "faces cross others that they did not at rest", lint);
}

}  // namespace

std::vector<JointTurn> turns_of_joint(const WeldedRig& rig, std::size_t joint) {
  Eigen::Vector3d along = Eigen::Vector3d::Zero();
  for (const int child : rig.children[joint]) along += rig.joints[at(child)] - rig.joints[joint];
  const int parent = rig.asset().skeleton.parents[joint];
  const double shortest = 1e-9 * rig.size;
  if (!(along.norm() > shortest) && parent >= 0) along = rig.joints[joint] - rig.joints[at(parent)];
  if (!(along.norm() > shortest)) along = Eigen::Vector3d::UnitZ();
  along.normalize();
  const Eigen::Vector3d first = along.unitOrthogonal(), second = along.cross(first);
  return {{joint, first, kTurn}, {joint, first, -kTurn}, {joint, second, kTurn}, {joint, second, -kTurn}};
}

std::vector<double> shares_moved(const WeldedRig& rig, std::size_t joint) {
  std::vector<char> below(rig.joint_count(), 0);
  below[joint] = 1;
  const std::vector<int>& parents = rig.asset().skeleton.parents;
  for (std::size_t j = joint + 1; j < rig.joint_count(); ++j) below[j] = below[at(parents[j])];
  below[joint] = 1;
  std::vector<double> shares(rig.places.size(), 0.0);
  for (const WeldedRig::Entry& entry : rig.entries) {
    if (below[at(entry.joint)] != 0) shares[at(entry.place)] += entry.weight;
  }
  return shares;
}

std::vector<Eigen::Vector3f> turned_places(const WeldedRig& rig, const JointTurn& turn,
                                           const std::vector<double>& shares) {
  const Eigen::Matrix3d rotation = Eigen::AngleAxisd(turn.angle, turn.axis).toRotationMatrix();
  const Eigen::Vector3d& center = rig.joints[turn.joint];
  std::vector<Eigen::Vector3f> posed = rig.places;
  for (std::size_t p = 0; p < posed.size(); ++p) {
    if (!(shares[p] > 0.0)) continue;
    const Eigen::Vector3d place = rig.places[p].cast<double>();
    posed[p] = (place + shares[p] * (rotation * (place - center) + center - place)).cast<float>();
  }
  return posed;
}

void check_poses(const WeldedRig& rig, std::uint64_t seed, RigLint& lint) {
  if (rig.faces.empty()) return;
  check_shape(rig, seed, lint);
  check_gaps(rig, seed, lint);
  check_crossings(rig, lint);
}

}  // namespace anigen::lint
