#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/engine/rig.h"
#include "anigen/rigging/rig_meshes.h"

namespace anigen {

inline constexpr const char* kAnigen = "anigen";
inline constexpr const char* kAnymate = "anymate";
inline constexpr const char* kRignet = "rignet";
inline constexpr const char* kLearnedSkin = "learned";  ///< word of --skin

/// The command line of anigen-rig.
struct RigArguments {
  engine::RigOptions rig;       ///< its words of method and skin may be those above, too
  rigging::RigRequest request;  ///< what the library has no option for; from engine::rig_request() on all of it
  std::string mesh, mesh_up = "format", image, background = "auto", condition = "color";
  std::vector<std::string> image_splits;
  std::string image_dataset, retrieval_encoder;
  std::string format;       ///< of the files in a folder; "": glb
  std::string joint_model;  ///< of Anymate or RigNet; of anigen a folder of both flows, empty: the shipped weights
  std::string connectivity_model, skin_model;  ///< of Anymate or RigNet
  std::string skin_run;                        ///< of the learned skin; empty: that of the shipped weights
  std::int64_t points = 0;
  double joint_distance = 0.0;
  std::size_t views = 0, limit = 0;
  bool preview = false, no_graft = false, rigid_parts = false;
  double rigid_share = kRigidShare;
};

}  // namespace anigen
