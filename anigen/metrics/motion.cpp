#include "anigen/metrics/motion.h"

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <tuple>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/rigs/bvh.h"
#include "anigen/io/rigs/read_assimp.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/metrics/alignment.h"
#include "anigen/metrics/matching.h"
#include "anigen/metrics/surface.h"
#include "anigen/metrics/wasserstein.h"

namespace anigen::metrics {

namespace {

std::vector<Eigen::Matrix3d> matrices(const std::vector<Eigen::Quaterniond>& turns) {
  std::vector<Eigen::Matrix3d> result;
  for (const Eigen::Quaterniond& turn : turns) result.push_back(turn.toRotationMatrix());
  return result;
}

double first_key(const Animation& animation) {
  double first = std::numeric_limits<double>::infinity();
  for (const Channel& channel : animation.channels) {
    if (!channel.times.empty()) first = std::min(first, channel.times.front());
  }
  return std::min(first, animation.duration());
}

/// By singular values: a joint scales along its own axes, which are not the world's.
double scaling_of(const Eigen::Matrix3d& linear) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(linear);
  const Eigen::Vector3d scales = svd.singularValues();  // in falling order
  return std::max(std::abs(scales[0] - 1.0), std::abs(scales[2] - 1.0));
}

using Turns = std::vector<Eigen::Quaterniond>;

/// Local rotations: the bind pose, then the poses.
std::vector<Turns> key_poses(std::size_t joints, std::uint64_t seed, const std::string& asset) {
  DeformationOptions options;
  options.seed = stable_hash(asset, seed);
  std::vector<Turns> keys(1, Turns(joints, Eigen::Quaterniond::Identity()));
  for (int pose = 0; pose < kSequencePoses; ++pose) {
    Turns turns;
    for (const Eigen::Matrix3d& rotation : random_rotations(joints, options, pose)) turns.emplace_back(rotation);
    keys.push_back(std::move(turns));
  }
  return keys;
}

namespace fs = std::filesystem;

struct Clips {
  Skeleton skeleton;
  std::vector<Animation> animations;
};

Clips read_clips(const fs::path& file) {
  io::require_content(file);
  const std::string extension = io::lower_extension(file);
  if (extension == ".bvh") {
    io::BvhMotion read = io::read_bvh(file);
    return {std::move(read.skeleton), {std::move(read.animation)}};
  }
  const bool is_gltf = extension == ".glb" || extension == ".gltf";
  if (!is_gltf && extension != ".fbx" && extension != ".dae")
    throw InputError(file.string(), "", "a motion is a .bvh, .glb, .gltf, .fbx or .dae");
  io::ImportOptions options;
  options.require_rig = false;  // clips of motion libraries come without a mesh
  Asset asset = (is_gltf ? io::read_gltf(file, options) : io::read_assimp(file, options)).asset;
  if (asset.animations.empty()) throw InputError(file.string(), "", "there is no clip in it");
  return {std::move(asset.skeleton), std::move(asset.animations)};
}

const Animation& named_clip(const Clips& clips, const std::string& wanted, const fs::path& file) {
  for (const Animation& animation : clips.animations) {
    if (animation.name == wanted) return animation;
  }
  std::string known;
  for (std::size_t i = 0; i < clips.animations.size(); ++i) {
    if (std::to_string(i) == wanted) return clips.animations[i];
    known += (i > 0 ? ", '" : "'") + clips.animations[i].name + "'";
  }
  throw InputError(file.string(), "clip '" + wanted + "'", "there is no such clip; there are " + known);
}

/// A file name may hold the sign, too.
std::pair<fs::path, std::string> file_and_clip_of(const std::string& text) {
  std::error_code ignored;
  const std::size_t sign = text.rfind('#');
  if (sign == std::string::npos || fs::exists(text, ignored)) return {text, ""};
  return {text.substr(0, sign), text.substr(sign + 1)};
}

constexpr double kPiece = 0.05;  ///< longest piece of a bone, and mass of a joint without bones
constexpr double kMostPieces = 400;
constexpr double kNearlyEqual = 1e-9;  ///< far below any distance that matters

struct Piece {
  Eigen::Vector3d place;
  double mass;
  int joint;  ///< that moves it
};

double length_of(const JointTree& tree, std::size_t j) {
  return tree.parents[j] < 0 ? 0.0 : (tree.positions[j] - tree.positions[at(tree.parents[j])]).norm();
}

/// @param unit a length that masses are counted in
std::vector<Piece> pieces_of(const JointTree& tree, double unit) {
  double total = 0.0;
  for (std::size_t j = 0; j < tree.size(); ++j) total += length_of(tree, j) / unit;
  const double longest = std::max(kPiece, total / kMostPieces);
  std::vector<Piece> pieces;
  std::vector<bool> has_bone(tree.size(), false);
  for (std::size_t j = 0; j < tree.size(); ++j) {
    const double length = length_of(tree, j) / unit;
    if (!(length > kNearlyEqual)) continue;
    const int parent = tree.parents[j];
    has_bone[at(parent)] = true;
    const Eigen::Vector3d from = tree.positions[at(parent)], way = tree.positions[j] - from;
    const int count = static_cast<int>(std::ceil(length / longest * (1.0 - 1e-9)));
    for (int i = 0; i < count; ++i) pieces.push_back({from + (i + 0.5) / count * way, length / count, parent});
  }
  for (std::size_t j = 0; j < tree.size(); ++j) {
    if (!has_bone[j]) pieces.push_back({tree.positions[j], kPiece, static_cast<int>(j)});
  }
  const auto place = [&tree](const Piece& piece) {
    const Eigen::Vector3d &p = piece.place, &q = tree.positions[at(piece.joint)];
    return std::make_tuple(p.x(), p.y(), p.z(), q.x(), q.y(), q.z(), piece.mass);
  };
  std::stable_sort(pieces.begin(), pieces.end(), [&](const Piece& a, const Piece& b) { return place(a) < place(b); });
  return pieces;
}

/// The pieces' masses and, last, as much as the other side has: what is matched with nothing.
Eigen::VectorXd masses(const std::vector<Piece>& pieces, const std::vector<Piece>& others) {
  Eigen::VectorXd result(static_cast<Eigen::Index>(pieces.size()) + 1);
  for (std::size_t i = 0; i < pieces.size(); ++i) result[static_cast<Eigen::Index>(i)] = pieces[i].mass;
  double spare = 0.0;
  for (const Piece& other : others) spare += other.mass;
  result[result.size() - 1] = spare;
  return result;
}

struct Share {
  std::size_t joint;
  double weight;
};
using Shares = std::vector<Share>;  ///< of one target joint; weights sum to 1

void check_plan(const Motion& source, const JointTree& target, const Eigen::MatrixXd& plan) {
  check(target, "target skeleton");
  const auto n = static_cast<Eigen::Index>(target.size()), m = static_cast<Eigen::Index>(source.joints.size());
  if (plan.rows() != n || plan.cols() != m) {
    throw InputError("", "transport plan",
                     std::to_string(plan.rows()) + " x " + std::to_string(plan.cols()) + " for " + std::to_string(n) +
                         " target and " + std::to_string(m) + " source joints");
  }
  if (!plan.allFinite() || plan.minCoeff() < 0.0)
    throw InputError("", "transport plan", "an entry is negative or not finite");
}

Shares shares_of(const Eigen::MatrixXd& plan, std::size_t joint) {
  const auto row = plan.row(static_cast<Eigen::Index>(joint));
  const double sum = row.sum();
  Shares shares;
  double kept = 0.0;
  for (Eigen::Index s = 0; s < plan.cols(); ++s) {
    // Compared without dividing, so that a row of zeros gives nothing.
    if (row[s] > 0.0 && row[s] >= kLeastShare * sum) {
      shares.push_back({static_cast<std::size_t>(s), row[s]});
      kept += row[s];
    }
  }
  if (shares.empty() && sum > 0.0) {  // more than ten sources, none with a tenth: the strongest
    Eigen::Index best = 0;
    row.maxCoeff(&best);
    shares.push_back({static_cast<std::size_t>(best), 1.0});
    kept = 1.0;
  }
  for (Share& share : shares) share.weight /= kept;
  return shares;
}

std::size_t nearest(const Eigen::Vector3d& place, const JointTree& tree) {
  std::size_t best = 0;
  for (std::size_t j = 1; j < tree.size(); ++j) {
    if ((tree.positions[j] - place).squaredNorm() < (tree.positions[best] - place).squaredNorm()) best = j;
  }
  return best;
}

/// Source joints of every target joint's motion; an empty list: from its parent.
std::vector<Shares> all_shares(const Motion& source, const JointTree& target, const Eigen::MatrixXd& plan) {
  std::vector<Shares> result;
  for (std::size_t j = 0; j < target.size(); ++j) {
    result.push_back(shares_of(plan, j));
    if (result[j].empty() && target.parents[j] < 0)
      result[j].push_back({nearest(target.positions[j], source.joints), 1.0});
  }
  return result;
}

Eigen::Quaterniond mean_turn(const MotionFrame& frame, const Shares& shares) {
  if (shares.size() == 1) return frame.turns[shares[0].joint];
  // Eigenvector of the largest eigenvalue of Σ w q qᵀ, in which q and −q are the same.
  Eigen::Matrix4d sum = Eigen::Matrix4d::Zero();
  for (const Share& share : shares) {
    const Eigen::Vector4d q = frame.turns[share.joint].coeffs();
    sum += share.weight * q * q.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> solver(sum);
  return Eigen::Quaterniond(Eigen::Vector4d(solver.eigenvectors().col(3))).normalized();
}

Eigen::Vector3d mean_shift(const MotionFrame& frame, const Shares& shares) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Share& share : shares) sum += share.weight * frame.shifts[share.joint];
  return sum;
}

using Vertices = std::vector<Eigen::Vector3f>;

double vertex_distance(const Vertices& a, const Vertices& b) {
  double sum = 0.0;
  for (std::size_t v = 0; v < a.size(); ++v) sum += (a[v].cast<double>() - b[v].cast<double>()).norm();
  return sum / static_cast<double>(a.size());
}

Mesh with_vertices(const std::vector<Triangle>& faces, Vertices vertices) {
  Mesh mesh;
  mesh.faces = faces;
  mesh.vertices = std::move(vertices);
  return mesh;
}

/// The first clip that moves(), else nothing: .frames is empty. @param frames as in motion_of()
Motion first_moving_clip(const std::vector<Animation>& animations, const Skeleton& skeleton, int frames) {
  for (const Animation& animation : animations) {
    Motion motion = motion_of(animation, skeleton, frames);
    if (moves(motion)) return motion;
  }
  return {};
}

}  // namespace

Motion motion_of(const Animation& animation, const Skeleton& skeleton, int frames) {
  require_between(frames, 1, 10000, "frames of a motion");
  Motion motion;
  motion.name = animation.name;
  motion.joints = joint_tree(skeleton);
  std::vector<Eigen::Matrix4d> from_bind;
  for (const Eigen::Matrix4d& bind : skeleton.bind) from_bind.emplace_back(bind.inverse());
  const std::vector<int> order = parents_first(motion.joints);
  const double first = first_key(animation), last = animation.duration();
  for (int f = 0; f < frames; ++f) {
    MotionFrame frame;
    frame.time = frames == 1 ? first : first + (last - first) * f / (frames - 1);
    const std::vector<Eigen::Matrix4d> world =
        forward_kinematics(skeleton.parents, sample(animation, skeleton, frame.time));
    for (std::size_t j = 0; j < world.size(); ++j) {
      const Eigen::Matrix4d since = world[j] * from_bind[j];
      frame.turns.push_back(decompose(since).rotation);
      motion.scaling = std::max(motion.scaling, scaling_of(since.topLeftCorner<3, 3>()));
    }
    const std::vector<RigidMotion> turned = rigid_motions(motion.joints, order, matrices(frame.turns));
    for (std::size_t j = 0; j < world.size(); ++j)
      frame.shifts.push_back(world[j].topRightCorner<3, 1>() - turned[j](motion.joints.positions[j]));
    motion.frames.push_back(std::move(frame));
    if (first == last) break;  // a single pose: more frames would repeat it at the same time
  }
  return motion;
}

std::vector<RigidMotion> rigid_motions(const JointTree& tree, const MotionFrame& frame) {
  std::vector<RigidMotion> result = rigid_motions(tree, parents_first(tree), matrices(frame.turns));
  for (std::size_t j = 0; j < result.size(); ++j) result[j].shift += frame.shifts[j];
  return result;
}

Motion transformed(const Similarity& similarity, Motion motion) {
  const Eigen::Quaterniond turn(similarity.rotation);
  motion.joints = transformed(similarity, std::move(motion.joints));
  for (MotionFrame& frame : motion.frames) {
    for (Eigen::Quaterniond& rotation : frame.turns) rotation = (turn * rotation * turn.conjugate()).normalized();
    for (Eigen::Vector3d& shift : frame.shifts) shift = similarity.scale * (similarity.rotation * shift);
  }
  return motion;
}

bool moves(const Motion& motion) {
  constexpr double kLeast = 1e-3;
  const double size = size_of(motion.joints);
  const MotionFrame& first = motion.frames.front();
  for (const MotionFrame& frame : motion.frames) {
    for (std::size_t j = 0; j < frame.turns.size(); ++j) {
      if (frame.turns[j].angularDistance(first.turns[j]) > kLeast) return true;
      if ((frame.shifts[j] - first.shifts[j]).norm() > kLeast * size) return true;
    }
  }
  return false;
}

double size_of(const JointTree& tree) {
  Box box;
  for (const Eigen::Vector3d& position : tree.positions) box.extend(position);
  const double size = box.longest_side();
  return size > 0.0 ? size : 1.0;
}

Motion pose_sequence(const JointTree& tree, std::uint64_t seed, const std::string& asset, int frames) {
  check(tree, asset);
  require_between(frames, 1, 10000, "frames of a motion");
  const std::vector<Turns> keys = key_poses(tree.size(), seed, asset);
  const std::vector<int> order = parents_first(tree);
  Motion motion;
  motion.name = "random poses";
  motion.joints = tree;
  for (int f = 0; f < frames; ++f) {
    MotionFrame frame;
    frame.time = static_cast<double>(keys.size()) * f / frames;
    const auto key = static_cast<std::size_t>(frame.time);
    const Turns &before = keys[key], &after = keys[(key + 1) % keys.size()];
    frame.turns.resize(tree.size());
    frame.shifts.assign(tree.size(), Eigen::Vector3d::Zero());
    for (const int j : order) {
      const Eigen::Quaterniond local = before[at(j)].slerp(frame.time - static_cast<double>(key), after[at(j)]);
      const int parent = tree.parents[at(j)];
      frame.turns[at(j)] = parent < 0 ? local : (frame.turns[at(parent)] * local).normalized();
    }
    motion.frames.push_back(std::move(frame));
  }
  return motion;
}

MotionFile read_motion(const std::string& file_and_clip, int frames) {
  const auto [file, clip] = file_and_clip_of(file_and_clip);
  const Clips clips = read_clips(file);
  MotionFile result;
  if (clip.empty()) {
    result.motion = first_moving_clip(clips.animations, clips.skeleton, frames);
  } else {
    result.motion = motion_of(named_clip(clips, clip, file), clips.skeleton, frames);
    if (!moves(result.motion)) result.motion.frames.clear();
  }
  if (result.motion.frames.empty())
    throw InputError(file.string(), clip.empty() ? "" : "clip '" + clip + "'", "nothing moves in it");
  result.described = {{"file", file.string()},
                      {"sha256", sha256(read_file(file))},
                      {"clip", result.motion.name},
                      {"joints", result.motion.joints.size()}};
  return result;
}

Eigen::MatrixXd motion_plan(const JointTree& target, const JointTree& source, double reach) {
  check(target, "target skeleton");
  check(source, "source skeleton");
  if (!(reach > 0.0) || !std::isfinite(reach)) throw InputError("", "reach", "must be positive and finite");
  const double unit = size_of(source);
  const std::vector<Piece> rows = pieces_of(target, unit), columns = pieces_of(source, unit);
  const Eigen::MatrixXd ties = joint_ties(target, source);

  const auto n = static_cast<Eigen::Index>(rows.size()), m = static_cast<Eigen::Index>(columns.size());
  Eigen::MatrixXd cost = Eigen::MatrixXd::Constant(n + 1, m + 1, 0.5 * reach * reach);
  cost(n, m) = 0.0;
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index k = 0; k < m; ++k) {
      const Piece &a = rows[at(i)], &b = columns[at(k)];
      // Beyond reach² nothing is matched; a smaller range leaves the solver more digits for ties.
      const double apart = std::min(((a.place - b.place) / unit).squaredNorm(), 2.0 * reach * reach);
      cost(i, k) = apart + kNearlyEqual * ties(a.joint, b.joint) / unit;
    }
  }
  // Lengths are no small multiples of one unit, which augmenting paths would need.
  const Eigen::MatrixXd plan =
      exact_transport(cost, masses(rows, columns), masses(columns, rows), ExactSolver::kNetworkSimplex).plan;

  Eigen::MatrixXd result =
      Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(target.size()), static_cast<Eigen::Index>(source.size()));
  for (Eigen::Index i = 0; i < n; ++i) {
    for (Eigen::Index k = 0; k < m; ++k) result(rows[at(i)].joint, columns[at(k)].joint) += plan(i, k);
  }
  return result;
}

Motion retarget(const Motion& source, const JointTree& target, const Eigen::MatrixXd& plan, double scale) {
  check_plan(source, target, plan);
  const std::vector<Shares> shares = all_shares(source, target, plan);
  const std::vector<int> order = parents_first(target);
  Motion result;
  result.name = source.name;
  result.joints = target;
  result.scaling = source.scaling;
  for (const MotionFrame& frame : source.frames) {
    MotionFrame moved;
    moved.time = frame.time;
    moved.turns.resize(target.size());
    moved.shifts.resize(target.size());
    for (const int j : order) {
      const int parent = target.parents[at(j)];
      const bool follows = shares[at(j)].empty();
      moved.turns[at(j)] = follows ? moved.turns[at(parent)] : mean_turn(frame, shares[at(j)]);
      moved.shifts[at(j)] =
          follows ? moved.shifts[at(parent)] : Eigen::Vector3d(scale * mean_shift(frame, shares[at(j)]));
    }
    result.frames.push_back(std::move(moved));
  }
  return result;
}

Motion retarget(const Motion& source, const JointTree& target) {
  return retarget(source, target, motion_plan(target, source.joints));
}

Motion retarget_freely(const Motion& source, const JointTree& target) {
  const Similarity from = normalization(source.joints.positions, NormalizationMode::kBoundingBox);
  const Similarity to = normalization(target.positions, NormalizationMode::kBoundingBox);
  const Eigen::MatrixXd plan = motion_plan(transformed(to, target), transformed(from, source.joints), kFarReach);
  Motion grounded = source;
  const Eigen::Vector3d start = source.frames.front().shifts[at(roots(source.joints).front())];
  for (MotionFrame& frame : grounded.frames) {
    for (Eigen::Vector3d& shift : frame.shifts) shift -= start;
  }
  return retarget(grounded, target, plan, from.scale / to.scale);
}

Animation to_animation(const Motion& motion, const Skeleton& skeleton) {
  const std::size_t count = skeleton.size();
  if (motion.joints.size() != count) {
    throw InputError("", "motion",
                     std::to_string(motion.joints.size()) + " joints for a skeleton of " + std::to_string(count));
  }
  const JointTree tree = joint_tree(skeleton);
  std::vector<double> times;
  std::vector<std::vector<double>> rotations(count), translations(count), scales(count);
  std::vector<bool> rescaled(count, false);
  for (const MotionFrame& frame : motion.frames) {
    const std::vector<RigidMotion> moved = rigid_motions(tree, frame);
    std::vector<Eigen::Matrix4d> world(skeleton.bind);
    for (std::size_t j = 0; j < count; ++j) {
      world[j].topLeftCorner<3, 3>() = moved[j].turn * skeleton.bind[j].topLeftCorner<3, 3>();
      world[j].topRightCorner<3, 1>() = moved[j](tree.positions[j]);
    }
    const Pose pose = local_pose(skeleton.parents, world);
    times.push_back(frame.time);
    for (std::size_t j = 0; j < count; ++j) {
      const Eigen::Quaterniond& q = pose[j].rotation;
      const Eigen::Vector3d &t = pose[j].translation, &s = pose[j].scale;
      rotations[j].insert(rotations[j].end(), {q.x(), q.y(), q.z(), q.w()});
      translations[j].insert(translations[j].end(), {t.x(), t.y(), t.z()});
      scales[j].insert(scales[j].end(), {s.x(), s.y(), s.z()});
      if ((s - skeleton.rest[j].scale).cwiseAbs().maxCoeff() > 1e-9) rescaled[j] = true;
    }
  }
  Animation animation;
  animation.name = motion.name;
  for (std::size_t j = 0; j < count; ++j) {
    const auto add = [&](ChannelPath path, std::vector<double>& values) {
      animation.channels.push_back({static_cast<int>(j), path, Interpolation::kLinear, times, std::move(values)});
    };
    add(ChannelPath::kRotation, rotations[j]);
    add(ChannelPath::kTranslation, translations[j]);
    if (rescaled[j]) add(ChannelPath::kScale, scales[j]);
  }
  return animation;
}

Animation retarget(const Animation& animation, const Skeleton& source, const Skeleton& target,
                   const Eigen::MatrixXd& plan, int frames, double scale) {
  return to_animation(retarget(motion_of(animation, source, frames), joint_tree(target), plan, scale), target);
}

MotionScore motion_score(const io::RiggedShape& truth, const Motion& truth_motion, const io::RiggedShape& predicted,
                         const Motion& predicted_motion, const MotionScoreOptions& options) {
  MotionScore score;
  score.by_vertex =
      truth.mesh.vertices.size() == predicted.mesh.vertices.size() && truth.mesh.faces == predicted.mesh.faces;
  SurfaceOptions surface;
  surface.samples = options.samples;
  surface.seed = options.seed;
  const auto distance = [&](Vertices of_truth, Vertices of_prediction) {
    if (score.by_vertex) return vertex_distance(of_truth, of_prediction);
    return surface_scores(with_vertices(predicted.mesh.faces, std::move(of_prediction)),
                          with_vertices(truth.mesh.faces, std::move(of_truth)), surface)
        .chamfer;
  };
  score.rest = distance(truth.mesh.vertices, predicted.mesh.vertices);
  for (std::size_t f = 0; f < truth_motion.frames.size(); ++f) {
    const double here =
        distance(posed_vertices(truth, rigid_motions(truth.joints, truth_motion.frames[f])),
                 posed_vertices(predicted, rigid_motions(predicted.joints, predicted_motion.frames[f])));
    score.moving += here / static_cast<double>(truth_motion.frames.size());
    score.largest = std::max(score.largest, here);
  }
  return score;
}

Motion truth_motion(const io::RiggedShape& truth, const Similarity& placement, const Motion* given, std::uint64_t seed,
                    int frames) {
  if (given != nullptr) return retarget_freely(*given, truth.joints);
  if (truth.clips != nullptr && truth.clips->skeleton.size() == truth.joints.size()) {
    Similarity turn;
    turn.rotation = truth.clips_turn;
    Motion own = first_moving_clip(truth.clips->animations, truth.clips->skeleton, frames);
    if (!own.frames.empty()) {
      own = transformed(compose(placement, turn), std::move(own));
      own.joints = truth.joints;
      return own;
    }
  }
  return pose_sequence(truth.joints, seed, truth.id, frames);
}

}  // namespace anigen::metrics
