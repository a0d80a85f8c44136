#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/job.h"

namespace anigen::engine {

/// Options of a rig, as those of anigen-rig (docs/rigging.md).
struct RigOptions {
  /// auto, curve, pinocchio, or for joints that the mesh has: nearest, geovoxel, heat. auto keeps joints that the mesh
  /// has, else takes joints of the shipped flows where these are sure, else a template that fits, else the curve.
  std::string method = "auto";
  std::string skin;                    ///< nearest, geovoxel, heat; empty: as the method says
  std::vector<std::string> templates;  ///< species for auto and pinocchio, such as "fox"; empty: the usual ones
  bool keep_skeleton = true;           ///< auto: joints that the mesh has stay
  bool learned_joints = true;          ///< auto may ask the shipped flows, which takes seconds and LibTorch
  bool separate_bodies = true;         ///< auto: bodies that stand apart get joints one by one
  std::size_t joints = 0;              ///< exactly so many; 0: as many as there are
  bool symmetric = false;              ///< left and right mirror each other
  bool add_joints = false;             ///< for what the skeleton that the mesh has leaves out
  std::size_t influences = 4;          ///< joints per vertex; 0: any number
  double rigid_share = 0.0;  ///< shells with such a share of one joint, above 0.5, follow it alone; 0: weights stay
  // For an engine.
  std::string bone_axes;  ///< "along" or "world"; empty: as they are
  std::string names;      ///< chain, vrm, mixamo, unreal, unity; empty: as they are
  double height = 0.0;    ///< metres; 0: the size stays
  bool ground = false;    ///< feet at z = 0
  bool root_bone = false;
};

struct Rigged {
  Asset asset;
  std::string note;  ///< how joints and weights came about, in one line
  double seconds = 0.0;
};

/// Rigs a mesh. Base colours with their images and, where its own joints stay, clips are kept; for all that a glTF
/// holds beside, see rig_file().
/// @param mesh its skeleton counts where it has one @param job null: nobody watches
/// @throws InputError for an unknown word, a mesh without a surface, or where the method finds no joints; Interrupted
Rigged rig(const Asset& mesh, const RigOptions& options = {}, Job* job = nullptr);

/// Rigs a file into a file. From glTF to glTF everything that is not the rig stays byte for byte. @param to .glb .gltf
/// .vrm .fbx .usda .usdz @return the note of Rigged @throws as rig(); InputError when `to` would replace an input;
/// WriteError
std::string rig_file(const std::filesystem::path& from, const std::filesystem::path& to, const RigOptions& options = {},
                     Job* job = nullptr);

/// Words of RigOptions::templates.
std::vector<std::string> template_words();

}  // namespace anigen::engine
