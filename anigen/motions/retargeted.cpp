#include "anigen/motions/retargeted.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <utility>

#include "anigen/core/log.h"
#include "anigen/core/numeric.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/rigs/read_assimp.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/motions/contact.h"
#include "anigen/motions/gaits.h"

namespace anigen::motions {

namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;

/// Source of the motion of one joint.
struct Counterpart {
  int joint = -1;                                 ///< of the source; -1: moves with its parent
  Quaterniond aligned = Quaterniond::Identity();  ///< turns the bind pose's bone to the source's
};

/// Places along a chain where its bones begin, 0 … 1.
std::vector<double> beginnings(const Body& body, const std::vector<int>& joints, const Vector3d& end) {
  std::vector<double> places = {0.0};
  const auto& p = body.figure.tree.positions;
  for (std::size_t i = 0; i < joints.size(); ++i) {
    const Vector3d next = i + 1 < joints.size() ? p[at(joints[i + 1])] : end;
    places.push_back(places.back() + (next - p[at(joints[i])]).norm());
  }
  const double all = std::max(places.back(), 1e-12);
  for (double& place : places) place /= all;
  return places;
}

Vector3d bone_of(const Body& body, const std::vector<int>& joints, std::size_t i, const Vector3d& end) {
  const auto& p = body.figure.tree.positions;
  return (i + 1 < joints.size() ? p[at(joints[i + 1])] : end) - p[at(joints[i])];
}

bool is_alike(const Body& a, const Body& b) {
  const auto count = [](const Body& body, LimbKind kind) { return body.of_kind(kind).size(); };
  if (a.leg_pairs().empty() || a.leg_pairs().size() != b.leg_pairs().size()) return false;
  return a.is_upright() == b.is_upright() && (count(a, LimbKind::kArm) > 1) == (count(b, LimbKind::kArm) > 1);
}

class Matching {
 public:
  /// @param turn from the source's frame to the target's
  Matching(const Body& target, const Body& source, const Eigen::Matrix3d& turn)
      : target_(target), source_(source), turn_(turn), found_(target.figure.joints()) {
    for (int j = target.trunk.front(); j >= 0 && target.figure.is_below(j, target.root);
         j = target.figure.tree.parents[at(j)])
      found_[at(j)].joint = source.trunk.front();
    found_[at(target.root)].joint = source.trunk.front();
    const auto& ends = source.figure.tree.positions;
    match(target.trunk, target.figure.tree.positions[at(target.trunk.back())], source.trunk,
          ends[at(source.trunk.back())], false);
    for (const LimbKind kind : {LimbKind::kHead, LimbKind::kTail}) {
      const std::vector<int> here = target.of_kind(kind), there = source.of_kind(kind);
      if (here.empty() || there.empty()) continue;
      const Limb &one = target.limbs[at(here.front())], &other = source.limbs[at(there.front())];
      match(one.joints, one.tip, other.joints, other.tip, false);
    }
    const auto own_pairs = target.leg_pairs(), other_pairs = source.leg_pairs();
    for (std::size_t i = 0; i < own_pairs.size(); ++i) {
      for (std::size_t side = 0; side < 2; ++side)
        match_leg(target.limbs[at(own_pairs[i][side])], source.limbs[at(other_pairs[i][side])]);
    }
    for (const int i : target.of_kind(LimbKind::kArm)) {
      for (const int k : source.of_kind(LimbKind::kArm)) {
        const Limb &one = target.limbs[at(i)], &other = source.limbs[at(k)];
        if (one.side == other.side && one.side != 0) match_arm(one, other);
      }
    }
  }

  const std::vector<Counterpart>& found() const { return found_; }

 private:
  void match(const std::vector<int>& joints, const Vector3d& end, const std::vector<int>& others,
             const Vector3d& other_end, bool align) {
    const std::vector<double> here = beginnings(target_, joints, end), there = beginnings(source_, others, other_end);
    for (std::size_t i = 0; i < joints.size(); ++i) {
      const double middle = 0.5 * (here[i] + here[i + 1]);
      std::size_t k = 0;
      while (k + 1 < others.size() && there[k + 1] <= middle) ++k;
      Counterpart& one = found_[at(joints[i])];
      one.joint = others[k];
      if (!align) continue;
      const Vector3d bone = bone_of(target_, joints, i, end), other = turn_ * bone_of(source_, others, k, other_end);
      if (bone.norm() > 0.0 && other.norm() > 0.0) one.aligned = Quaterniond::FromTwoVectors(bone, other);
    }
  }

  static std::vector<int> part(const Limb& limb, std::size_t from, std::size_t to) {
    return {limb.joints.begin() + static_cast<std::ptrdiff_t>(from),
            limb.joints.begin() + static_cast<std::ptrdiff_t>(to)};
  }

  void match_leg(const Limb& one, const Limb& other) {
    const auto& here = target_.figure.tree.positions;
    const auto& there = source_.figure.tree.positions;
    for (std::size_t i = 0; i < one.hip; ++i) found_[at(one.joints[i])].joint = other.attached;
    if (one.ankle == one.hip || other.ankle == other.hip) {
      match(part(one, one.hip, one.joints.size()), one.contact, part(other, other.hip, other.joints.size()),
            other.contact, true);
      return;
    }
    const bool both_bend = one.knee > one.hip && other.knee > other.hip;
    if (both_bend) {
      match(part(one, one.hip, one.knee), here[at(one.joints[one.knee])], part(other, other.hip, other.knee),
            there[at(other.joints[other.knee])], true);
      match(part(one, one.knee, one.ankle), here[at(one.joints[one.ankle])], part(other, other.knee, other.ankle),
            there[at(other.joints[other.ankle])], true);
    } else {
      match(part(one, one.hip, one.ankle), here[at(one.joints[one.ankle])], part(other, other.hip, other.ankle),
            there[at(other.joints[other.ankle])], true);
    }
    match(part(one, one.ankle, one.joints.size()), one.tip, part(other, other.ankle, other.joints.size()), other.tip,
          false);
  }

  void match_arm(const Limb& one, const Limb& other) {
    const std::size_t upper = upper_arm(target_, one), other_upper = upper_arm(source_, other);
    for (std::size_t i = 0; i < upper; ++i) {
      // Collar bones move as the source's do, from the bind pose; without one they rest on the chest.
      found_[at(one.joints[i])].joint = other_upper > 0 ? other.joints[other_upper - 1] : other.attached;
    }
    // Bones of upper arm and forearm one by one, the hand as the forearm: fingers say little about its direction.
    for (std::size_t i = upper; i < one.joints.size(); ++i) {
      const std::size_t k = std::min(other_upper + (i - upper), other.joints.size() - 1);
      Counterpart& found = found_[at(one.joints[i])];
      found.joint = other.joints[k];
      const bool is_hand = i >= upper + 2;
      if (is_hand) {
        found.aligned = found_[at(one.joints[i - 1])].aligned;
        continue;
      }
      const Vector3d bone = bone_of(target_, one.joints, i, one.tip),
                     there = turn_ * bone_of(source_, other.joints, k, other.tip);
      if (bone.norm() > 0.0 && there.norm() > 0.0) found.aligned = Quaterniond::FromTwoVectors(bone, there);
    }
  }

  const Body& target_;
  const Body& source_;
  Eigen::Matrix3d turn_;
  std::vector<Counterpart> found_;
};

/// The turn about the vertical from one horizontal direction to another.
Eigen::Matrix3d level_turn(const Vector3d& from, const Vector3d& to) {
  const double angle = std::atan2(from.cross(to).z(), from.dot(to));
  return Eigen::AngleAxisd(angle, Vector3d::UnitZ()).toRotationMatrix();
}

JointMotions posed(const Body& body, const metrics::MotionFrame& frame, const std::vector<Counterpart>& found,
                   const Vector3d& shift) {
  const Figure& figure = body.figure;
  std::vector<Quaterniond> turns(figure.joints(), Quaterniond::Identity());
  JointMotions result(figure.joints());
  for (const int j : figure.order) {
    const int parent = figure.tree.parents[at(j)];
    const Counterpart& one = found[at(j)];
    if (one.joint >= 0) {
      turns[at(j)] = (frame.turns[at(one.joint)] * one.aligned).normalized();
    } else if (parent >= 0) {
      turns[at(j)] = turns[at(parent)];
    }
    const Vector3d& here = figure.tree.positions[at(j)];
    const Vector3d place = parent < 0 ? Vector3d(here + shift) : result[at(parent)](here);
    result[at(j)].turn = turns[at(j)].toRotationMatrix();
    result[at(j)].shift = place - result[at(j)].turn * here;
  }
  return result;
}

/// Lowest z of the surface over all poses, every vertex moved by the joint that holds it most.
double lowest_surface(const Figure& figure, const std::vector<JointMotions>& poses) {
  double lowest = std::numeric_limits<double>::infinity();
  for (const JointMotions& pose : poses) {
    for (std::size_t j = 0; j < figure.joints(); ++j) {
      for (const Vector3d& p : figure.surface[j]) lowest = std::min(lowest, pose[j](p).z());
    }
  }
  return lowest;
}

void raise(double by, std::vector<JointMotions>& poses) {
  for (JointMotions& pose : poses) {
    for (metrics::RigidMotion& one : pose) one.shift.z() += by;
  }
}

/// Frames in which feet of the source stand: low, and nearly at rest.
std::vector<FootContact> standing_feet(const Body& target, const Body& source, const metrics::Motion& motion) {
  std::vector<FootContact> result;
  const auto own = target.leg_pairs(), other = source.leg_pairs();
  const double length = std::max(source.leg_length(), 1e-9);
  std::vector<std::vector<metrics::RigidMotion>> rigid;
  for (const metrics::MotionFrame& frame : motion.frames) rigid.push_back(metrics::rigid_motions(motion.joints, frame));
  for (std::size_t i = 0; i < own.size(); ++i) {
    for (std::size_t side = 0; side < 2; ++side) {
      const Limb& leg = source.limbs[at(other[i][side])];
      const int end = leg.joints[leg.ankle];
      std::vector<Vector3d> soles;
      double lowest = std::numeric_limits<double>::infinity();
      for (const auto& pose : rigid) {
        soles.push_back(pose[at(end)](leg.contact));
        lowest = std::min(lowest, soles.back().z());
      }
      FootContact contact{own[i][side], std::vector<bool>(soles.size(), false)};
      for (std::size_t f = 0; f < soles.size(); ++f) {
        const std::size_t before = f > 0 ? f - 1 : 0, after = std::min(f + 1, soles.size() - 1);
        const double time = motion.frames[after].time - motion.frames[before].time;
        const Vector3d way = soles[after] - soles[before];
        const bool rests = time > 0.0 && way.norm() / time < 0.35 * length;
        contact.stands[f] = rests && soles[f].z() < lowest + 0.08 * length;
      }
      result.push_back(std::move(contact));
    }
  }
  return result;
}

}  // namespace

SourceClip source_clip(metrics::Motion motion, const std::vector<std::string>& names) {
  Body body = analyse(figure_of(motion.joints, names));
  return {std::move(motion), std::move(body)};
}

SourceClip read_clip(const std::string& file_and_clip, const MotionOptions& options) {
  int frames = options.frames;
  if (frames == 0) {
    constexpr int kProbe = 64;  // enough to see that something moves
    const metrics::Motion probe = metrics::read_motion(file_and_clip, kProbe).motion;
    const double seconds = probe.frames.back().time - probe.frames.front().time;
    // Keys per second of the clip that is made, which runs `speed` times as fast.
    const long wanted = std::lround(seconds / options.speed * options.fps) + 1;
    constexpr long kMost = 10000;
    if (wanted > kMost)
      log::warn("{}: {} key frames at {} per second; it gets {}", file_and_clip, wanted, options.fps, kMost);
    frames = static_cast<int>(std::clamp(wanted, 2L, kMost));
  }
  const metrics::MotionFile read = metrics::read_motion(file_and_clip, frames);
  const std::filesystem::path file = read.described.at("file").get<std::string>();
  if (io::has_extension(file, {".bvh"})) return source_clip(read.motion);
  io::ImportOptions import_options;
  import_options.require_rig = false;
  const bool is_gltf = io::has_extension(file, {".glb", ".gltf"});
  const Asset asset = (is_gltf ? io::read_gltf(file, import_options) : io::read_assimp(file, import_options)).asset;
  const bool is_skinned = asset.skin.rows() > 0 && !asset.mesh.vertices.empty();
  return is_skinned ? SourceClip{read.motion, analyse(asset)} : source_clip(read.motion, asset.skeleton.names);
}

Retargeted retarget_to(const Body& body, const SourceClip& clip) {
  Retargeted result;
  result.motion.name = clip.motion.name;
  result.motion.loops = false;
  metrics::Similarity turn;
  turn.rotation = level_turn(clip.body.figure.forward, body.figure.forward);
  const metrics::Motion source = metrics::transformed(turn, clip.motion);
  const double first = source.frames.front().time;
  for (const metrics::MotionFrame& frame : source.frames) result.motion.times.push_back(frame.time - first);
  if (!is_alike(body, clip.body)) {
    const metrics::Motion moved = metrics::retarget_freely(source, body.figure.tree);
    for (const metrics::MotionFrame& frame : moved.frames)
      result.motion.poses.push_back(metrics::rigid_motions(moved.joints, frame));
    const double below = body.figure.box.low.z() - lowest_surface(body.figure, result.motion.poses);
    if (below > 0.0) {
      raise(below, result.motion.poses);
      result.raised = below / body.figure.height;
    }
    return result;
  }
  result.by_limbs = true;
  const Matching matching(body, clip.body, turn.rotation);
  const double scale = body.leg_length() / std::max(clip.body.leg_length(), 1e-12);
  const int pelvis = clip.body.trunk.front();
  const Vector3d start = source.frames.front().shifts[at(pelvis)];
  double lowest = std::numeric_limits<double>::infinity(), ground = lowest;
  for (const metrics::MotionFrame& frame : source.frames) {
    JointMotions pose = posed(body, frame, matching.found(), scale * (frame.shifts[at(pelvis)] - start));
    for (const auto& pair : body.leg_pairs()) {
      for (const int i : pair) {
        const Limb& leg = body.limbs[at(i)];
        lowest = std::min(lowest, pose[at(leg.joints[leg.ankle])](leg.contact).z());
        ground = std::min(ground, leg.contact.z());
      }
    }
    result.motion.poses.push_back(std::move(pose));
  }
  raise(ground - lowest, result.motion.poses);
  result.motion.contacts = standing_feet(body, clip.body, clip.motion);
  result.standing = keep_feet(body, result.motion);
  return result;
}

}  // namespace anigen::motions
