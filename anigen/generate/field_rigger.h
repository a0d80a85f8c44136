#pragma once
#include <cstdint>
#include <filesystem>
#include <memory>

#include "anigen/asset/rigged_asset.h"
#include "anigen/asset/skeleton.h"
#include "anigen/generate/run_weights.h"
#include "anigen/generate/stage_generators.h"
#include "anigen/rigging/rig_meshes.h"

namespace anigen::generate {

/// Agreement (FieldRigger::Found) from which the joints are trusted without being asked for, before those of a template
/// that fits and of the curve. Chosen on 64 creatures and 23 public rigs that the flows had not seen; those that
/// docs/rigging.md reports are others.
inline constexpr double kTrustedAgreement = 0.5;

/// True for a run of stage 4 or 5 that was trained without images, as a FieldRigger needs them. @throws InputError
/// without a config
bool is_rig_flow(const std::filesystem::path& run);

/// Finds the skeleton of a given mesh by the fields of the generator: both flows without images, the first trained on
/// given shapes (SparseStructureFlowStageOptions::p_given_shape). The mesh's voxels give the voxels of its skeleton,
/// both give skeleton latents, whose decoded votes are grouped to joints and parents (paper 3.2 and 3.4).
class FieldRigger {
 public:
  struct Request {
    FlowRuns flows;  ///< runs of both; their auto-encoders are those that their configs name
    std::string device = "cpu";
    std::uint64_t seed = 42;  ///< of the noise, the same for every mesh
  };
  /// @throws InputError when a run is unusable, or was trained with images or without given shapes
  explicit FieldRigger(const Request& request);

  /// A skeleton, and how sure the first flow is of it.
  struct Found {
    Skeleton skeleton;                    ///< joints, parents and names, in the shape's frame
    skeleton_field::SkeletonField votes;  ///< that its joints were grouped from, in the unit cube
    Similarity to_cube;                   ///< from the shape's frame
    double agreement = 0.0;  ///< IoU of the skeleton's voxels of the shape and of its mirror image, mirrored back
  };
  /// The shape is seen twice, as it is and in the mirror x = 0, for the skeleton's voxels
  /// (StructureGenerator::skeleton_of()) as for the votes, which are grouped together. The shape stands as creatures of
  /// the training do: upright, facing −Y.
  /// @throws InputError without a surface; Error when the flows find no skeleton voxels
  Found find(const io::RiggedShape& shape);

  skeleton_field::MeanShiftForm grouping_form() const { return decoder_->grouping_form(); }

  /// The steps of rig_meshes() that find joints: of any mesh, and those with at least kTrustedAgreement.
  static rigging::LearnedSteps steps(const std::shared_ptr<FieldRigger>& rigger);

 private:
  /// Votes in the unit cube. @param skeleton bool [R, R, R], some of it true
  skeleton_field::SkeletonField votes_at(const torch::Tensor& voxels, const torch::Tensor& skeleton);

  Request request_;
  StructureGenerator structure_;
  StructuredLatentGenerator latents_;
  std::unique_ptr<RigDecoder> decoder_;
};

}  // namespace anigen::generate
