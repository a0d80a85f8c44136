#include "anigen/prepare/augment/pose_augmentation.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "anigen/asset/skinning.h"
#include "anigen/asset/validate.h"
#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/core/sha256.h"
#include "anigen/prepare/augment/bake_pose.h"
#include "anigen/prepare/augment/own_motion.h"
#include "anigen/prepare/augment/random_pose.h"

namespace anigen::prepare {
namespace {

constexpr double kGoldenRatio = 0.6180339887498949;  // its multiples modulo 1 fill the unit interval most evenly
constexpr double kDegrees = 180.0 / EIGEN_PI;
constexpr double kTurned = 0.1;  // degrees: less is rounding, not posing
constexpr int kMostAttempts = 1000;

// A pose that was drawn, before anyone looked at it.
struct Draw {
  std::vector<Eigen::Matrix4d> world;
  std::size_t turned = 0;
  double largest_angle = 0.0;  // degrees
};

void count_turn(Draw& draw, double degrees) {
  if (degrees <= kTurned) return;
  ++draw.turned;
  draw.largest_angle = std::max(draw.largest_angle, degrees);
}

Draw draw_random(const Skeleton& skeleton, const PoseAugmentation& options, Rng& rng) {
  const JointTurns turns =
      draw_turns(skeleton.size(), options.probability, options.max_angle / kDegrees, options.include_root, rng);
  Draw draw;
  draw.world = turned_joints(skeleton, turns);
  for (const double angle : turns.angles) count_turn(draw, angle * kDegrees);
  return draw;
}

Draw draw_motion(const Skeleton& skeleton, const Pose& bind, const Pose& pose) {
  Draw draw;
  draw.world = forward_kinematics(skeleton.parents, pose);
  for (std::size_t j = 0; j < pose.size(); ++j) {
    count_turn(draw, bind[j].rotation.angularDistance(pose[j].rotation) * kDegrees);
  }
  return draw;
}

void require_sound(const Asset& asset, const std::string& source_id) {
  // Animations are judged one by one, later: a broken clip costs that clip only.
  Asset body;
  body.mesh = asset.mesh;
  body.skeleton = asset.skeleton;
  body.skin = asset.skin;
  body.materials = asset.materials;
  body.images.resize(asset.images.size());
  const std::vector<std::string> findings = validate(body);
  if (!findings.empty()) throw InputError(source_id, "asset", "cannot be posed: " + findings.front());
}

}  // namespace

void PoseAugmentation::validate() const {
  const auto in_range = [](const char* name, double value, double low, double high, const char* range) {
    if (!(value >= low && value <= high)) throw InputError("", name, std::string("must be in ") + range);
  };
  in_range("blend_probability", blend_probability, 0.0, 1.0, "0 … 1");
  in_range("least_motion", least_motion, 0.0, 1e6, "0 … 1e6");
  in_range("probability", probability, 0.0, 1.0, "0 … 1");
  in_range("max_angle", max_angle, 0.0, 180.0, "0 … 180 degrees");
  in_range("attempts", attempts, 1.0, kMostAttempts, "1 … 1000");
  limits.validate();
}

Json to_json(const PoseAugmentation& options) {
  Json json;
  json["own_motion"] = options.own_motion;
  json["blend_probability"] = options.blend_probability;
  json["least_motion"] = options.least_motion;
  json["probability"] = options.probability;
  json["max_angle"] = options.max_angle;
  json["include_root"] = options.include_root;
  json["attempts"] = options.attempts;
  json["limits"] = to_json(options.limits);
  return json;
}

std::string variant_id(const std::string& source_id, std::uint64_t seed, std::size_t k,
                       const PoseAugmentation& options) {
  return sha256("pose/" + std::to_string(kPoseRecipe) + "/" + source_id + "/" + std::to_string(seed) + "/" +
                std::to_string(k) + "/" + to_json(options).dump());
}

struct PoseAugmenter::Implementation {
  const Asset* asset;
  std::string source_id;
  std::uint64_t seed;
  PoseAugmentation options;
  PoseChecks checks;
  Pose bind;
  OwnMotion motion;
  double first_place;

  Implementation(const Asset& normalised, std::string id, std::uint64_t a_seed, PoseAugmentation some_options)
      : asset(&normalised),
        source_id(std::move(id)),
        seed(a_seed),
        options(std::move(some_options)),
        checks(normalised.mesh),
        bind(bind_pose(normalised.skeleton)),
        motion(normalised, options.least_motion),
        first_place(Rng(seed, "first place of " + source_id).uniform()) {}

  Draw draw(PoseKind kind, std::size_t k, int attempt, Provenance& provenance) const {
    Rng rng(seed, to_string(kind) + " pose " + std::to_string(k) + " of " + source_id,
            static_cast<std::uint64_t>(attempt));
    provenance.clip.clear();
    provenance.time = provenance.second_time = provenance.blend = 0.0;
    if (kind == PoseKind::kRandom) return draw_random(asset->skeleton, options, rng);
    // The first draw keeps its place in the even spread over the motion; only those after a rejection roam.
    const double place = attempt > 0 ? rng.uniform() : first_place + static_cast<double>(k) * kGoldenRatio;
    MotionPose pose = motion.at(place - std::floor(place));
    if (rng.chance(options.blend_probability)) pose = motion.blended(pose, rng);
    provenance.clip = asset->animations[pose.clip].name;
    provenance.time = pose.time;
    provenance.second_time = pose.second_time;
    provenance.blend = pose.blend;
    return draw_motion(asset->skeleton, bind, pose.pose);
  }

  // Vertices of the pose; nothing when a limit is broken, with the sentence in `problem`.
  std::optional<std::vector<Eigen::Vector3f>> accepted(const std::vector<Eigen::Matrix4d>& world,
                                                       PoseMeasures& measures, std::string& problem) const {
    if (const std::optional<std::size_t> joint = collapsed_joint(world)) {
      problem = "joint '" + asset->skeleton.names[*joint] + "' has no extent in this pose";
      return std::nullopt;
    }
    std::vector<Eigen::Vector3f> vertices = skin_vertices(*asset, world);
    measures = checks.measure(vertices);
    problem = broken_limit(measures, options.limits);
    if (!problem.empty()) return std::nullopt;
    return vertices;
  }
};

PoseAugmenter::PoseAugmenter(const Asset& normalised, std::string source_id, std::uint64_t seed,
                             PoseAugmentation options) {
  options.validate();
  require_sound(normalised, source_id);
  if (!(bounding_box(normalised.mesh.vertices).longest_side() > 0.0)) {
    throw InputError(source_id, "mesh", "cannot be posed: it has no extent");
  }
  implementation_ = std::make_unique<Implementation>(normalised, std::move(source_id), seed, std::move(options));
}

PoseAugmenter::~PoseAugmenter() = default;
PoseAugmenter::PoseAugmenter(PoseAugmenter&&) noexcept = default;
PoseAugmenter& PoseAugmenter::operator=(PoseAugmenter&&) noexcept = default;

std::optional<Asset> PoseAugmenter::variant(std::size_t k, Provenance& provenance) const {
  const Implementation& self = *implementation_;
  provenance = Provenance();
  provenance.source_id = self.source_id;
  provenance.seed = self.seed;
  provenance.k = k;
  provenance.unused_clips = self.motion.unused();
  for (const PoseKind kind : {PoseKind::kAnimation, PoseKind::kRandom}) {
    if (kind == PoseKind::kAnimation && (!self.options.own_motion || self.motion.empty())) continue;
    provenance.kind = kind;
    for (int attempt = 0; attempt < self.options.attempts; ++attempt) {
      const Draw draw = self.draw(kind, k, attempt, provenance);
      provenance.turned = draw.turned;
      provenance.largest_angle = draw.largest_angle;
      std::string problem;
      std::optional<std::vector<Eigen::Vector3f>> vertices = self.accepted(draw.world, provenance.measures, problem);
      if (!vertices) {
        provenance.rejections.push_back(to_string(kind) + ": " + problem);
        provenance.attempt = static_cast<int>(provenance.rejections.size());
        continue;
      }
      Asset posed = bake_pose(*self.asset, draw.world, std::move(*vertices));
      posed.name += "_pose" + std::to_string(k);
      provenance.renormalization = normalize(posed);
      return posed;
    }
  }
  return std::nullopt;
}

std::optional<Asset> posed_variant(const Asset& normalised, const std::string& source_id, std::uint64_t seed,
                                   std::size_t k, const PoseAugmentation& options, Provenance& provenance) {
  return PoseAugmenter(normalised, source_id, seed, options).variant(k, provenance);
}

}  // namespace anigen::prepare
