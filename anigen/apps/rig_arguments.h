#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/rigging/rig_meshes.h"

namespace anigen {

inline constexpr const char* kAnymate = "anymate";
inline constexpr const char* kRignet = "rignet";

/// The command line of anigen-rig.
struct RigArguments {
  std::string method, mesh, axes = "format", skin, image, background = "auto", condition = "color";
  std::vector<std::string> pictured;
  std::string joint_model, connectivity_model, skin_model;  ///< of Anymate or RigNet
  std::int64_t points = 0;
  double eps = 0.0;
  rigging::RigRequest request;
  std::size_t views = 0, most = 0;
  bool pictures = false;
};

}  // namespace anigen
