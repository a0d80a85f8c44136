#include "anigen/prepare/pose_augmentation.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <numeric>
#include <set>
#include <unordered_map>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/hash.h"
#include "anigen/render/picture.h"

namespace anigen::prepare {

namespace {

// Bytes of what makes two vertices the same place of one smooth surface: position and normal before, position after.
using PlaceKey = std::array<float, 9>;

struct PlaceHash {
  std::size_t operator()(const PlaceKey& key) const {
    return static_cast<std::size_t>(
        stable_hash({reinterpret_cast<const char*>(key.data()), key.size() * sizeof(float)}));
  }
};

// Vertices are split where texture coordinates jump. Seen alone, the two sides of such a seam turn differently, and the
// seam would show; so they are joined first. Hard edges, whose normals differ, stay apart.
std::vector<Eigen::Vector3f> turned_normals(const Mesh& mesh, const std::vector<Eigen::Vector3f>& posed) {
  std::unordered_map<PlaceKey, std::int32_t, PlaceHash> places;
  std::vector<std::int32_t> place_of(mesh.vertices.size());
  Mesh joined;
  std::vector<Eigen::Vector3f> joined_posed;
  for (std::size_t v = 0; v < place_of.size(); ++v) {
    PlaceKey key;
    for (int i = 0; i < 3; ++i) {
      const auto at = static_cast<std::size_t>(i);
      // + 0 makes -0 and 0 the same bytes.
      key[at] = mesh.vertices[v][i] + 0.0f;
      key[at + 3] = mesh.normals[v][i] + 0.0f;
      key[at + 6] = posed[v][i] + 0.0f;
    }
    const auto [entry, is_new] = places.emplace(key, static_cast<std::int32_t>(joined.vertices.size()));
    if (is_new) {
      joined.vertices.push_back(mesh.vertices[v]);
      joined.normals.push_back(mesh.normals[v]);
      joined_posed.push_back(posed[v]);
    }
    place_of[v] = entry->second;
  }
  for (Triangle face : mesh.faces) {
    for (std::int32_t& corner : face) corner = place_of[static_cast<std::size_t>(corner)];
    joined.faces.push_back(face);
  }
  const std::vector<Eigen::Vector3f> turned = render::posed_normals(joined, joined_posed);
  std::vector<Eigen::Vector3f> normals(place_of.size());
  for (std::size_t v = 0; v < normals.size(); ++v) {
    const Eigen::Vector3f& normal = turned[static_cast<std::size_t>(place_of[v])];
    const float length = normal.norm();
    normals[v] = length > 1e-6f ? Eigen::Vector3f(normal / length) : mesh.normals[v];
  }
  return normals;
}

bool same(const std::vector<Eigen::Matrix4d>& a, const std::vector<Eigen::Matrix4d>& b) {
  for (std::size_t j = 0; j < a.size(); ++j) {
    const Eigen::Matrix4d difference = (a[j] - b[j]).cwiseAbs();
    const double size = a[j].topLeftCorner<3, 3>().cwiseAbs().maxCoeff();
    if (difference.topRightCorner<3, 1>().maxCoeff() > 1e-6) return false;
    if (difference.topLeftCorner<3, 3>().maxCoeff() > 1e-5 * size) return false;
  }
  return true;
}

constexpr std::size_t kTimes = 33;
constexpr std::size_t kVertices = 256;

using Points = std::vector<Eigen::Vector3d>;

// Some of the mesh's vertices, which can be posed quickly.
class Witnesses {
 public:
  explicit Witnesses(const Asset& asset) : asset_(&asset) {
    const std::size_t count = asset.mesh.vertices.size(), step = std::max<std::size_t>(1, count / kVertices);
    for (std::size_t v = 0; v < count && vertices_.size() < kVertices; v += step) vertices_.push_back(v);
    for (const Eigen::Matrix4d& bind : asset.skeleton.bind) from_bind_.push_back(bind.inverse());
  }

  // Positions in a pose, their mean subtracted: what moves as one does not count as movement.
  Points posed(const Pose& pose) const {
    std::vector<Eigen::Matrix4d> world = forward_kinematics(asset_->skeleton.parents, pose);
    for (std::size_t j = 0; j < world.size(); ++j) world[j] = world[j] * from_bind_[j];
    Points points;
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const std::size_t v : vertices_) {
      const Eigen::Vector4d vertex = asset_->mesh.vertices[v].cast<double>().homogeneous();
      Eigen::Vector3d sum = Eigen::Vector3d::Zero();
      for (std::size_t i = 0; i < asset_->skin.row_size(v); ++i) {
        const Influence& influence = asset_->skin.row(v)[i];
        sum += static_cast<double>(influence.weight) *
               (world[static_cast<std::size_t>(influence.joint)] * vertex).head<3>();
      }
      points.push_back(sum);
      mean += sum;
    }
    mean /= static_cast<double>(points.size());
    for (Eigen::Vector3d& point : points) point -= mean;
    return points;
  }

 private:
  const Asset* asset_;
  std::vector<std::size_t> vertices_;
  std::vector<Eigen::Matrix4d> from_bind_;
};

double rms_distance(const Points& a, const Points& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += (a[i] - b[i]).squaredNorm();
  return std::sqrt(sum / static_cast<double>(a.size()));
}

double longest_side(const Points& points) {
  Box box;
  for (const Eigen::Vector3d& point : points) box.extend(point);
  return box.longest_side();
}

double time_at(double begin, double end, std::size_t i) {
  return begin + (end - begin) * static_cast<double>(i) / static_cast<double>(kTimes - 1);
}

/// Problem of a clip's keys; empty when nothing is.
std::string broken_keys(const Animation& animation, std::size_t joints) {
  if (animation.channels.empty()) return "it has no channels";
  for (const Channel& channel : animation.channels) {
    if (channel.joint < 0 || static_cast<std::size_t>(channel.joint) >= joints)
      return "it moves a joint that is missing";
    const std::size_t numbers = channel.path == ChannelPath::kRotation ? 4 : 3;
    const std::size_t width = channel.interpolation == Interpolation::kCubicSpline ? 3 * numbers : numbers;
    if (channel.times.empty() || channel.values.size() != width * channel.times.size())
      return "a channel does not have one value per key";
    for (std::size_t i = 0; i < channel.times.size(); ++i) {
      if (!std::isfinite(channel.times[i])) return "a key's time is not finite";
      if (i > 0 && !(channel.times[i] > channel.times[i - 1])) return "key times do not increase";
    }
    for (const double value : channel.values) {
      if (!std::isfinite(value)) return "a key is not finite";
    }
  }
  return "";
}

constexpr double kGoldenRatio = 0.6180339887498949;  // its multiples modulo 1 fill the unit interval most evenly
constexpr double kDegrees = 180.0 / EIGEN_PI;
constexpr double kTurned = 0.1;  // degrees: less is rounding, not posing
constexpr int kMostAttempts = 1000;

/// @return the asset @throws InputError for options out of range, or when it cannot be posed. Animations are judged one
/// by one, later: a broken clip costs that clip only.
const Asset* checked(const Asset& asset, const std::string& source_id, const PoseAugmentation& options) {
  options.validate();
  Asset body;
  body.mesh = asset.mesh;
  body.skeleton = asset.skeleton;
  body.skin = asset.skin;
  body.materials = asset.materials;
  body.images.resize(asset.images.size());
  const std::vector<std::string> findings = validate(body);
  if (!findings.empty()) throw InputError(source_id, "asset", "cannot be posed: " + findings.front());
  if (!(bounding_box(asset.mesh.vertices).longest_side() > 0.0))
    throw InputError(source_id, "mesh", "cannot be posed: it has no extent");
  return &asset;
}

}  // namespace

std::optional<std::size_t> collapsed_joint(const std::vector<Eigen::Matrix4d>& world) {
  for (std::size_t j = 0; j < world.size(); ++j) {
    if (!world[j].allFinite()) return j;
    const Eigen::JacobiSVD<Eigen::Matrix3d> svd(world[j].topLeftCorner<3, 3>());
    const Eigen::Vector3d stretches = svd.singularValues();
    if (!(stretches[2] > 1e-9 * stretches[0]) || !(stretches[0] > 1e-30)) return j;
  }
  return std::nullopt;
}

Asset bake_pose(const Asset& asset, const std::vector<Eigen::Matrix4d>& world, std::vector<Eigen::Vector3f> vertices) {
  Asset baked;
  baked.name = asset.name;
  baked.mesh = asset.mesh;
  if (!asset.mesh.normals.empty()) baked.mesh.normals = turned_normals(asset.mesh, vertices);
  baked.mesh.vertices = std::move(vertices);
  baked.skin = asset.skin;
  baked.materials = asset.materials;
  baked.images = asset.images;
  Skeleton& skeleton = baked.skeleton;
  skeleton.names = asset.skeleton.names;
  skeleton.parents = asset.skeleton.parents;
  skeleton.bind = world;
  skeleton.rest = bind_pose(skeleton);
  if (same(skeleton.bind, forward_kinematics(skeleton.parents, skeleton.rest))) return baked;
  for (Eigen::Matrix4d& frame : skeleton.bind)
    frame.topLeftCorner<3, 3>() = decompose(frame).rotation.toRotationMatrix();
  skeleton.rest = bind_pose(skeleton);
  return baked;
}

OwnMotion::OwnMotion(const Asset& asset, double least_motion) : asset_(&asset) {
  const Witnesses witnesses(asset);
  for (std::size_t c = 0; c < asset.animations.size(); ++c) {
    const Animation& animation = asset.animations[c];
    std::string problem = broken_keys(animation, asset.skeleton.size());
    Clip clip;
    clip.index = c;
    if (problem.empty()) {
      clip.begin = animation.channels.front().times.front();
      clip.end = clip.begin;
      for (const Channel& channel : animation.channels) {
        clip.begin = std::min(clip.begin, channel.times.front());
        clip.end = std::max(clip.end, channel.times.back());
      }
      std::vector<Points> poses;
      double size = 0.0;
      for (std::size_t i = 0; i < kTimes; ++i) {
        poses.push_back(witnesses.posed(sample(animation, asset.skeleton, time_at(clip.begin, clip.end, i))));
        size = std::max(size, longest_side(poses.back()));
      }
      // A clip whose poses have no extent moves nothing.
      const double unit = size > 0.0 ? 1.0 / size : 0.0;
      double range = 0.0;
      for (std::size_t i = 0; i < kTimes; ++i) {
        clip.way.push_back(i == 0 ? 0.0 : clip.way.back() + unit * rms_distance(poses[i - 1], poses[i]));
        range = std::max(range, unit * rms_distance(poses.front(), poses[i]));
      }
      if (!std::isfinite(clip.way.back()) || !std::isfinite(range)) {
        problem = "it moves vertices out of all bounds";
      } else if (!(clip.end > clip.begin)) {
        problem = "it has no length";
      } else if (!(range >= least_motion) || !(clip.way.back() > 0.0)) {
        problem = "it does not move the mesh";
      }
    }
    if (problem.empty()) {
      total_way_ += clip.way.back();
      std::set<double> times;
      for (const Channel& channel : animation.channels) times.insert(channel.times.begin(), channel.times.end());
      for (const double time : times) key_frames_.emplace_back(c, time);
      clips_.push_back(std::move(clip));
    } else {
      unused_.push_back(animation.name + ": " + problem);
    }
  }
}

MotionPose OwnMotion::at(double place) const {
  double target = std::clamp(place, 0.0, 1.0) * total_way_;
  std::size_t chosen = 0;
  while (chosen + 1 < clips_.size() && target >= clips_[chosen].way.back()) target -= clips_[chosen++].way.back();
  const Clip& clip = clips_[chosen];
  target = std::min(target, clip.way.back());
  // The first sampled time beyond the target, so that a pause before it is skipped.
  std::size_t after = 1;
  while (after + 1 < kTimes && clip.way[after] <= target) ++after;
  const double step = clip.way[after] - clip.way[after - 1];
  const double s = step > 0.0 ? std::clamp((target - clip.way[after - 1]) / step, 0.0, 1.0) : 0.0;
  MotionPose result;
  result.clip = clip.index;
  const double from = time_at(clip.begin, clip.end, after - 1), to = time_at(clip.begin, clip.end, after);
  result.time = result.second_time = from + s * (to - from);
  result.pose = sample(asset_->animations[clip.index], asset_->skeleton, result.time);
  return result;
}

MotionPose OwnMotion::key_frame(std::size_t i) const {
  MotionPose result;
  result.clip = key_frames_[i].first;
  result.time = result.second_time = key_frames_[i].second;
  result.pose = sample(asset_->animations[result.clip], asset_->skeleton, result.time);
  return result;
}

MotionPose OwnMotion::blended(const MotionPose& first, Rng& rng) const {
  const Clip& clip =
      *std::find_if(clips_.begin(), clips_.end(), [&](const Clip& one) { return one.index == first.clip; });
  MotionPose result = first;
  result.second_time = rng.uniform(clip.begin, clip.end);
  result.blend = rng.uniform(0.0, 0.5);
  const Pose second = sample(asset_->animations[clip.index], asset_->skeleton, result.second_time);
  for (std::size_t j = 0; j < second.size(); ++j) {
    Transform& joint = result.pose[j];
    joint.translation += result.blend * (second[j].translation - joint.translation);
    joint.scale += result.blend * (second[j].scale - joint.scale);
    joint.rotation = joint.rotation.slerp(result.blend, second[j].rotation).normalized();
  }
  return result;
}

void PoseAugmentation::validate() const {
  const auto in_range = [](const char* name, double value, double low, double high, const char* range) {
    if (!(value >= low && value <= high)) throw InputError("", name, std::string("must be in ") + range);
  };
  in_range("blend_probability", blend_probability, 0.0, 1.0, "0 … 1");
  in_range("least_motion", least_motion, 0.0, 1e6, "0 … 1e6");
  in_range("probability", probability, 0.0, 1.0, "0 … 1");
  in_range("max_angle", max_angle, 0.0, 180.0, "0 … 180 degrees");
  in_range("anisotropic_scale", anisotropic_scale, 0.0, 1.0, "0 … 1");
  in_range("attempts", attempts, 1.0, kMostAttempts, "1 … 1000");
  if (key_frames && !own_motion) throw InputError("", "key_frames", "are of the asset's own motion, which is off");
  limits.validate();
}

std::string variant_id(const std::string& source_id, std::uint64_t seed, std::size_t k,
                       const PoseAugmentation& options) {
  return sha256("pose/" + std::to_string(kPoseRecipe) + "/" + source_id + "/" + std::to_string(seed) + "/" +
                std::to_string(k) + "/" + settings_of(options).dump());
}

Json settings_of(const PoseAugmentation& options) {
  Json json = options;
  if (options.key_frames) json["key_frames"] = true;
  if (options.anisotropic_scale > 0.0) json["anisotropic_scale"] = options.anisotropic_scale;
  return json;
}

/// A pose that was drawn, before anyone looked at it.
struct PoseAugmenter::Draw {
  std::vector<Eigen::Matrix4d> world;
  std::size_t turned = 0;
  double largest_angle = 0.0;  ///< degrees

  void count_turn(double degrees) {
    if (degrees <= kTurned) return;
    ++turned;
    largest_angle = std::max(largest_angle, degrees);
  }
};

PoseAugmenter::PoseAugmenter(const Asset& normalised, std::string source_id, std::uint64_t seed,
                             PoseAugmentation options)
    : asset_(checked(normalised, source_id, options)),
      source_id_(std::move(source_id)),
      seed_(seed),
      options_(options),
      checks_(normalised.mesh),
      bind_(bind_pose(normalised.skeleton)),
      motion_(normalised, options_.least_motion),
      first_place_(Rng(seed, "first place of " + source_id_).uniform()),
      frame_order_(motion_.key_frames()) {
  std::iota(frame_order_.begin(), frame_order_.end(), std::size_t{0});
  Rng rng(seed, "order of key frames of " + source_id_);
  for (std::size_t i = frame_order_.size(); i > 1; --i) std::swap(frame_order_[i - 1], frame_order_[rng.index(i)]);
}

// The first draw keeps its place in the even spread over the motion, or in the order of key frames; only those after a
// rejection roam.
MotionPose PoseAugmenter::own_pose(std::size_t k, int attempt, Rng& rng) const {
  if (options_.key_frames) return motion_.key_frame(attempt > 0 ? rng.index(frame_order_.size()) : frame_order_[k]);
  const double place = attempt > 0 ? rng.uniform() : first_place_ + static_cast<double>(k) * kGoldenRatio;
  const MotionPose pose = motion_.at(place - std::floor(place));
  return rng.chance(options_.blend_probability) ? motion_.blended(pose, rng) : pose;
}

Eigen::Vector3d PoseAugmenter::axis_factors(std::size_t k) const {
  Rng rng(seed_, "axes of pose " + std::to_string(k) + " of " + source_id_);
  Eigen::Vector3d factors;
  for (double& factor : factors)
    factor = std::exp(rng.uniform(-options_.anisotropic_scale, options_.anisotropic_scale));
  return factors;
}

PoseAugmenter::Draw PoseAugmenter::draw(PoseKind kind, std::size_t k, int attempt, Provenance& provenance) const {
  Rng rng(seed_, to_string(kind) + " pose " + std::to_string(k) + " of " + source_id_,
          static_cast<std::uint64_t>(attempt));
  provenance.clip.clear();
  provenance.time = provenance.second_time = provenance.blend = 0.0;
  const Skeleton& skeleton = asset_->skeleton;
  Draw draw;
  if (kind == PoseKind::kRandom) {
    const JointTurns turns =
        draw_turns(skeleton.size(), options_.probability, options_.max_angle / kDegrees, options_.include_root, rng);
    draw.world = turned_joints(skeleton, turns);
    for (const double angle : turns.angles) draw.count_turn(angle * kDegrees);
    return draw;
  }
  const MotionPose motion = own_pose(k, attempt, rng);
  provenance.clip = asset_->animations[motion.clip].name;
  provenance.time = motion.time;
  provenance.second_time = motion.second_time;
  provenance.blend = motion.blend;
  draw.world = forward_kinematics(skeleton.parents, motion.pose);
  for (std::size_t j = 0; j < bind_.size(); ++j)
    draw.count_turn(bind_[j].rotation.angularDistance(motion.pose[j].rotation) * kDegrees);
  return draw;
}

std::optional<std::vector<Eigen::Vector3f>> PoseAugmenter::accepted(const std::vector<Eigen::Matrix4d>& world,
                                                                    PoseMeasures& measures,
                                                                    std::string& problem) const {
  if (const std::optional<std::size_t> joint = collapsed_joint(world)) {
    problem = "joint '" + asset_->skeleton.names[*joint] + "' has no extent in this pose";
    return std::nullopt;
  }
  std::vector<Eigen::Vector3f> vertices = skin_vertices(*asset_, world);
  measures = checks_.measure(vertices);
  problem = broken_limit(measures, options_.limits);
  if (!problem.empty()) return std::nullopt;
  return vertices;
}

std::optional<Asset> PoseAugmenter::variant(std::size_t k, Provenance& provenance) const {
  provenance = Provenance();
  provenance.source_id = source_id_;
  provenance.seed = seed_;
  provenance.k = k;
  provenance.unused_clips = motion_.unused();
  if (options_.key_frames && k >= frame_order_.size()) {
    provenance.kind = PoseKind::kAnimation;
    provenance.rejections.push_back("animation: the asset's clips have " + std::to_string(frame_order_.size()) +
                                    " key frames that can be used");
    return std::nullopt;
  }
  for (const PoseKind kind : {PoseKind::kAnimation, PoseKind::kRandom}) {
    if (kind == PoseKind::kRandom && options_.key_frames) continue;
    if (kind == PoseKind::kAnimation && (!options_.own_motion || motion_.empty())) continue;
    provenance.kind = kind;
    for (int attempt = 0; attempt < options_.attempts; ++attempt) {
      Draw drawn = draw(kind, k, attempt, provenance);
      provenance.turned = drawn.turned;
      provenance.largest_angle = drawn.largest_angle;
      std::string problem;
      std::optional<std::vector<Eigen::Vector3f>> vertices = accepted(drawn.world, provenance.measures, problem);
      if (!vertices) {
        provenance.rejections.push_back(to_string(kind) + ": " + problem);
        provenance.attempt = static_cast<int>(provenance.rejections.size());
        continue;
      }
      if (options_.anisotropic_scale > 0.0) {
        provenance.axis_factors = axis_factors(k);
        for (Eigen::Matrix4d& world : drawn.world)
          world.topRows<3>() = provenance.axis_factors.asDiagonal() * world.topRows<3>();
        for (Eigen::Vector3f& vertex : *vertices) vertex = vertex.cwiseProduct(provenance.axis_factors.cast<float>());
      }
      Asset posed = bake_pose(*asset_, drawn.world, std::move(*vertices));
      posed.name += "_pose" + std::to_string(k);
      provenance.renormalization = normalize(posed);
      return posed;
    }
  }
  return std::nullopt;
}

}  // namespace anigen::prepare
