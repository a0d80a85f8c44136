#pragma once
#include <cstdint>
#include <memory>
#include <string>

#include "anigen/loaders/anymate/anymate_samples.h"
#include "anigen/loaders/rignet/bone_slots.h"
#include "anigen/loaders/rignet/solid_shape.h"
#include "anigen/models/rignet/options.h"

namespace anigen::loaders {

/// How meshes become graphs.
struct RignetMeshOptions {
  std::size_t most_vertices = 2000;     ///< larger meshes are simplified
  std::size_t geodesic_samples = 4000;  ///< of the surface, for distances along it
  std::uint64_t seed = 0;               ///< of these samples and of the edges within balls
};

struct RignetConversion {
  RignetMeshOptions mesh;
  models::rignet::Task task = models::rignet::Task::kJoints;
  std::int64_t bones = 5;     ///< slots of a vertex, for skinning
  bool held_out = false;      ///< with what scores need: points of the surface with their truth, the inside
  std::size_t points = 8192;  ///< of the surface
};

/// A rigged mesh for RigNet. What a task does not ask for is undefined.
struct RignetSample {
  /// Joints, bones, parents and, of what is held out, points with weights, exactly as Anymate's models are given them
  /// from the same asset, so that both are measured on the same truth. Anymate's frame.
  models::anymate::AnymateSample rig;
  RignetFrame frame;
  models::rignet::MeshGraph graph;
  torch::Tensor joints;                     ///< [J, 3] RigNet's frame
  torch::Tensor attention;                  ///< joints: [V] 0 or 1
  torch::Tensor inside, outside;            ///< connectivity: [J, J], SolidShape::ways
  models::rignet::BoneSlots slots;          ///< skinning: of rig.bones
  torch::Tensor weights;                    ///< skinning: [V, S] true weights of the slots
  torch::Tensor corners, shares;            ///< skinning, held out: [N, 3] vertices whose weighted mean each point is
  std::shared_ptr<const SolidShape> solid;  ///< joints, held out
};

/// @throws InputError naming the asset: as convert_rig and rignet_mesh
RignetSample convert_for_rignet(const RiggedItem& item, const RignetConversion& options);

/// Positions in RigNet's frame, [N, 3] fp32, from tensors in Anymate's; and back, fp64.
torch::Tensor in_rignet_frame(const torch::Tensor& anymate_points, const RignetFrame& frame);
std::vector<Eigen::Vector3d> in_anymate_frame(const torch::Tensor& rignet_points, const RignetFrame& frame);

}  // namespace anigen::loaders
