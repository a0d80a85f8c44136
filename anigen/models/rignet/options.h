#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/core/json.h"

namespace anigen::models::rignet {

/// What one model of RigNet is for; the published system trains one after the other.
enum class Task {
  kJoints,        ///< JointNet, MaskNet and the bandwidth of their clustering
  kConnectivity,  ///< BoneNet and RootNet
  kSkinning       ///< SkinNet
};

/// joints, connectivity, skin.
const std::vector<std::string>& task_names();
const std::string& name_of(Task task);

/// A model of RigNet (Xu et al. 2020; reference anymate-baselines.md, 9.3). Defaults are published.
struct RignetOptions {
  Task task = Task::kJoints;
  double width = 1.0;         ///< factor on every published layer width, for small models (ours)
  double dropout = 0.7;       ///< before the last layer of joints, attention and bones
  double bandwidth = 0.04;    ///< that mean shift starts from, in units of the longest side
  std::int64_t bones = 5;     ///< nearest ones that skinning weighs at a vertex
  bool mirrored = true;       ///< joints are predicted symmetric about x = 0
  double least_weight = 0.5;  ///< share of a vertex's largest weight that others must reach; the published demo: 0.35

  /// A published width times `width`, even, at least 8.
  std::int64_t wide(std::int64_t published) const;

  /// The names of this struct. @throws InputError for an unknown key or a value out of range
  static RignetOptions from_json(const Json& json, const std::string& file = "", const std::string& pointer = "");
};

}  // namespace anigen::models::rignet
