#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "anigen/rigging/rig_meshes.h"

namespace anigen {

inline constexpr const char* kAnymate = "anymate";
inline constexpr const char* kRignet = "rignet";

/// The command line of anigen-rig.
struct RigArguments {
  std::string method, mesh, mesh_up = "format", skin, image, background = "auto", condition = "color";
  std::vector<std::string> image_splits;
  std::string joint_model, connectivity_model, skin_model;  ///< of Anymate or RigNet
  std::int64_t points = 0;
  double joint_distance = 0.0;
  rigging::RigRequest request;
  std::size_t views = 0, limit = 0;
  std::optional<std::size_t> influences;  ///< joints per vertex; 0: any number
  bool preview = false;
};

}  // namespace anigen
