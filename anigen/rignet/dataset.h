#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <vector>

#include "anigen/anymate/dataset.h"
#include "anigen/core/config.h"
#include "anigen/data/batches.h"
#include "anigen/data/metadata.h"
#include "anigen/nn/torch.h"
#include "anigen/rignet/graph.h"
#include "anigen/rignet/model.h"
#include "anigen/rignet/surface_paths.h"

namespace anigen::rignet {

/// A mesh as one graph (docs/reference/rignet.md, 2): edges from the one-ring of each vertex, and from at most ten
/// vertices, drawn by (seed, vertex), of those within 0.06 of it along the surface; either time also from itself.
MeshGraph mesh_graph(const RignetMesh& mesh, const SurfacePaths& paths, std::uint64_t seed);

/// Vertices that MaskNet is to attend to (docs/reference/rignet.md, 3): 14 rays go from either end of each bone at
/// right angles to it; of an end's hits those nearer than twice their 20th percentile count, and vertices within 0.02
/// of one attend. Where a joint gets fewer than six this way, the six nearest to the joint do, too (our choice).
/// @param joints [J] RigNet's frame @param parents [J], its own index for a root @return [V] fp32, 0 or 1
torch::Tensor joint_attention(const RignetMesh& mesh, const std::vector<Eigen::Vector3d>& joints,
                              const std::vector<int>& parents);

/// Bones of a rig in RigNet's frame.
struct BoneEnds {
  std::vector<Eigen::Vector3d> heads, tails;  ///< [K]
};

/// Volumetric geodesic distances from every vertex to every bone (docs/reference/rignet.md, 5). A vertex sees a bone
/// when the ray from the bone's nearest point meets the surface first at the vertex, within 1e-4; it is then as far as
/// that ray is long. Any other, and those that see it from farther than 1.3 times the 15th percentile of who does, are
/// as far as the nearest vertex that sees it, along the surface, and that one from the bone; 8 and the straight
/// distance where no way leads there. @return [V][K] row by row, in units of the longest side
std::vector<double> volumetric_distances(const RignetMesh& mesh, const SurfacePaths& paths, const BoneEnds& bones);

/// The nearest `slots` bones of every vertex by those distances, with what SkinNet is told of each: head, tail, 1/D (D
/// at least 0.01, since a bone on the surface would drown everything else) and 1 for a bone at whose tail no other
/// begins. The published skeletons have a bone without length at each leaf joint instead; our bones of leaves have one.
/// @param distances of volumetric_distances @param slots at least 1
BoneSlots bone_slots(const std::vector<double>& distances, const BoneEnds& bones, std::int64_t slots);

/// Options for graphs of meshes.
struct RignetMeshOptions {
  std::size_t most_vertices = 2000;     ///< larger meshes are simplified
  std::size_t geodesic_samples = 4000;  ///< of the surface, for distances along it
  std::uint64_t seed = 0;               ///< of these samples and of the edges within balls
};

struct RignetConversion {
  RignetMeshOptions mesh;
  Task task = Task::kJoints;
  std::int64_t bones = 5;     ///< slots of a vertex, for skinning
  bool held_out = false;      ///< with what scores need: points of the surface with their truth, the inside
  std::size_t points = 8192;  ///< of the surface
};

/// A rigged mesh for RigNet. What a task does not ask for is undefined.
struct RignetSample {
  /// Joints, bones, parents and, of what is held out, points with weights, exactly as Anymate's models are given them
  /// from the same asset, so that both are measured on the same truth. Anymate's frame.
  anymate::AnymateSample rig;
  RignetFrame frame;
  MeshGraph graph;
  torch::Tensor joints;                     ///< [J, 3] RigNet's frame
  torch::Tensor attention;                  ///< joints: [V] 0 or 1
  torch::Tensor inside, outside;            ///< connectivity: [J, J], SolidShape::ways
  BoneSlots slots;                          ///< skinning: of rig.bones
  torch::Tensor weights;                    ///< skinning: [V, S] true weights of the slots
  torch::Tensor corners, shares;            ///< skinning, held out: [N, 3] vertices whose weighted mean each point is
  std::shared_ptr<const SolidShape> solid;  ///< joints, held out
};

/// Positions in RigNet's frame, [N, 3] fp32, from tensors in Anymate's; and back, fp64.
torch::Tensor in_rignet_frame(const torch::Tensor& anymate_points, const RignetFrame& frame);
std::vector<Eigen::Vector3d> in_anymate_frame(const torch::Tensor& rignet_points, const RignetFrame& frame);

/// Samples for RigNet, to be put together by whoever trains on them.
struct RignetDraws : data::Batch {
  std::vector<RignetSample> samples;
};

/// `dataset.args` of the class "Rignet" (ours): prepared data sets (source_options.h), their meshes as graphs.
struct RignetDatasetOptions : data::SourceOptions, anymate::RigSizes {
  RignetConversion conversion;  ///< most_vertices, geodesic_samples, points; the trainer sets the task

  static RignetDatasetOptions read(ConfigReader& reader);
};

/// most_vertices (2000) and geodesic_samples (4000): what rigging with a trained model also has to know.
RignetMeshOptions read_rignet_mesh_options(ConfigReader& reader);

/// Samples in memory.
class RignetDataset : public data::BatchSource {
 public:
  /// @param repeat how often an epoch visits each sample
  RignetDataset(std::vector<RignetSample> samples, const std::vector<std::size_t>& repeat);

  std::size_t size() const override { return visits_.size(); }
  std::size_t samples() const { return samples_.size(); }
  const RignetSample& sample(std::size_t index) const { return samples_[index]; }
  std::unique_ptr<data::Batch> load(const std::vector<data::Draw>& draws) const override;

 private:
  std::vector<RignetSample> samples_;
  std::vector<std::size_t> visits_;
};

struct RignetDatasets {
  std::shared_ptr<const RignetDataset> train, held_out;  ///< the latter null when nothing is held out
};

/// Reads and converts everything; what cannot be used is left out, counted and, with debug messages, named.
/// @throws InputError when nothing is left, and for files that cannot be read unless skip_broken
RignetDatasets open_rignet(const RignetDatasetOptions& options);

}  // namespace anigen::rignet
