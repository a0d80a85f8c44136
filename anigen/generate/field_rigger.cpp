#include "anigen/generate/field_rigger.h"

#include <algorithm>
#include <cstdio>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/run_folder.h"
#include "anigen/data/rigged_item.h"
#include "anigen/data/voxel_files.h"
#include "anigen/generate/assemble.h"
#include "anigen/generate/asset_generator.h"
#include "anigen/geometry/voxel_grid.h"
#include "anigen/geometry/voxelize.h"
#include "anigen/rigging/medial_ascent.h"
#include "anigen/rigging/pinocchio_solid.h"

namespace anigen::generate {

namespace {

using torch::Tensor;

StructureGenerator::Request structure_request(const FieldRigger::Request& request) {
  StructureGenerator::Request structure;
  structure.run = request.flows.structure;
  structure.device = request.device;
  structure.pictures = false;
  return structure;
}

FlowRequest latent_request(const FieldRigger::Request& request) {
  FlowRequest latents;
  latents.run = request.flows.latents;
  latents.device = request.device;
  latents.pictures = false;
  return latents;
}

/// Options that grouping_of_run() replaces by fitted values.
skeleton_field::MeanShiftOptions fitted_grouping() {
  skeleton_field::MeanShiftOptions options;
  options.bandwidth = 0.0F;
  options.min_cluster_size = 0;
  return options;
}

/// The similarity that normalize() applies to an asset of this mesh.
Similarity unit_cube_of(const io::RiggedShape& shape) {
  Asset asset;
  asset.name = shape.file;
  asset.mesh.vertices = shape.mesh.vertices;
  return normalize(asset);
}

/// bool [R, R, R], as datasets voxelise: on their stored grid, then pooled. @param resolution R
Tensor voxels_of(const io::RiggedShape& shape, const Similarity& to_cube, std::int64_t resolution) {
  std::vector<Eigen::Vector3d> vertices;
  for (const Eigen::Vector3f& vertex : shape.mesh.vertices)
    vertices.emplace_back(to_cube.scale * vertex.cast<double>() + to_cube.offset);
  const auto fine = geometry::voxelize_surface(vertices, shape.mesh.faces, data::kStoredResolution);
  const auto factor = static_cast<int>(data::kStoredResolution / resolution);
  Tensor grid = torch::zeros({resolution, resolution, resolution}, torch::kBool);
  for (const geometry::Voxel& voxel : geometry::pool_voxels(fine, factor)) grid[voxel[0]][voxel[1]][voxel[2]] = true;
  return grid;
}

/// The votes of a shape and those of its mirror image, mirrored back; what grouping does not read stays behind.
skeleton_field::SkeletonField with_mirrored(const skeleton_field::SkeletonField& own,
                                            const skeleton_field::SkeletonField& mirrored) {
  const Tensor back = torch::tensor({-1.0F, 1.0F, 1.0F}).to(own.joints.device());
  const auto confidences = [](const Tensor& a, const Tensor& b) { return a.defined() ? torch::cat({a, b}) : a; };
  skeleton_field::SkeletonField both;
  both.positions = torch::cat({own.positions, mirrored.positions * back});
  both.joints = torch::cat({own.joints, mirrored.joints * back});
  both.parents = torch::cat({own.parents, mirrored.parents * back});
  both.conf_j = confidences(own.conf_j, mirrored.conf_j);
  both.conf_p = confidences(own.conf_p, mirrored.conf_p);
  return both;
}

// Joints grouped from votes as they are err by half a voxel across a limb, and votes in its middle group better. Chosen
// on creatures and rigs that the flows had not seen (experiments/results/rigging/flows.md).
constexpr double kVoteReach = 0.02;   // of the unit cube
constexpr int kSolidResolution = 96;  // that of curve skeletons

/// Moves votes for joints across their bones, which lead from the votes for parents, to the middle of the solid that
/// the mesh suggests.
void centre_votes(skeleton_field::SkeletonField& votes, const Mesh& mesh, const Similarity& to_cube) {
  const rigging::SolidField solid = rigging::solid_field(mesh, 1.0, kSolidResolution);
  const double scale = solid.from_mesh.scale / to_cube.scale;  // cube → solid
  const Eigen::Vector3d offset = solid.from_mesh.offset - scale * to_cube.offset;
  const std::vector<Eigen::Vector3f> joints = nn::points_of(votes.joints, "joints"),
                                     parents = nn::points_of(votes.parents, "parents");
  std::vector<Eigen::Vector3d> points, along;
  for (std::size_t i = 0; i < joints.size(); ++i) {
    points.emplace_back(scale * joints[i].cast<double>() + offset);
    along.emplace_back((joints[i] - parents[i]).cast<double>());
  }
  points = rigging::ascend_to_medial(solid, points, along, scale * kVoteReach);
  std::vector<Eigen::Vector3f> centred;
  for (const Eigen::Vector3d& point : points) centred.emplace_back(((point - offset) / scale).cast<float>());
  votes.joints = data::points_tensor(centred).to(votes.joints.options());
}

std::string agreement_text(double agreement) {
  char text[80];
  std::snprintf(text, sizeof text, "agreement with the mirror image %.2f", agreement);
  return text;
}

}  // namespace

bool is_rig_flow(const std::filesystem::path& run) {
  const Json config = load_config(RunFolder{run}.config());
  const std::string dataset = config.value("/dataset/name"_json_pointer, "");
  return dataset == "AniGenSLat" || dataset == "AniGenSparseStructureLatent";
}

FieldRigger::FieldRigger(const Request& request)
    : request_(request), structure_(structure_request(request)), latents_(latent_request(request)) {
  if (!structure_.finds_skeletons()) {
    throw InputError(structure_.flow().config.string(), "/trainer/args/p_given_shape",
                     "a flow that finds the skeleton of a shape was trained with 1");
  }
  const data::StructuredLatentOptions& reading = latents_.reading();
  const std::filesystem::path autoencoder = nn::named_run(request.flows.latents, reading.slat_dec_path,
                                                          latents_.flow().config, "/dataset/args/slat_dec_path");
  decoder_ = std::make_unique<RigDecoder>(
      nn::find_run_model(autoencoder, structured_latent::kStructuredLatentDecoderClass, reading.slat_dec_ckpt),
      nn::parse_device(request.device), grouping_of_flow(fitted_grouping(), request.flows.latents, autoencoder));
  if (decoder_->options().resolution != latents_.options().resolution ||
      data::kStoredResolution % latents_.options().resolution != 0)
    throw InputError(autoencoder.string(), "", "works on other voxels than the flow " + request.flows.latents.string());
}

skeleton_field::SkeletonField FieldRigger::votes_at(const Tensor& voxels, const Tensor& skeleton) {
  structured_latent::StructuredLatentTarget target;
  target.shape = support_of(voxels);
  target.skeleton = support_of(skeleton);
  target.tokens = latents_.condition({});
  if (latents_.options().use_joint_num_cond)
    target.joints_num = torch::zeros({1}, torch::kInt64).to(target.tokens.device());
  const flow::Streams noise = latents_.noise(*target.shape, *target.skeleton, noise_generator(request_.seed));
  return decoder_->votes(latents_.sample(noise, target, latents_.sampler(), /*guided=*/false));
}

FieldRigger::Found FieldRigger::find(const io::RiggedShape& shape) {
  const torch::NoGradGuard no_grad;
  if (!shape.has_surface()) throw InputError(shape.file, "", "holds no surface to rig");
  Found found;
  found.to_cube = unit_cube_of(shape);
  const Tensor voxels = voxels_of(shape, found.to_cube, latents_.options().resolution);
  const auto [skeleton, agreement] = structure_.skeleton_of(voxels, structure_.noise(noise_generator(request_.seed)));
  found.agreement = agreement;
  if (!skeleton.any().item<bool>()) throw Error(shape.file + ": the first flow finds no skeleton in this shape");
  found.votes =
      with_mirrored(votes_at(voxels, skeleton), votes_at(voxels.flip({kGridAcross}), skeleton.flip({kGridAcross})));
  centre_votes(found.votes, shape.mesh, found.to_cube);
  const Skeleton unit = decoded_skeleton(decoder_->grouped(found.votes));
  std::vector<Eigen::Vector3d> joints = unit.positions();
  for (Eigen::Vector3d& joint : joints) joint = (joint - found.to_cube.offset) / found.to_cube.scale;
  found.skeleton = skeleton_from_joints(joints, unit.parents, unit.names);
  return found;
}

rigging::LearnedSteps FieldRigger::steps(const std::shared_ptr<FieldRigger>& rigger) {
  rigging::LearnedSteps steps;
  steps.propose = [rigger](const io::RiggedShape& shape, const rigging::JointProposer&) {
    const Found found = rigger->find(shape);
    return rigging::ProposedJoints{found.skeleton, "flows, " + agreement_text(found.agreement)};
  };
  steps.sure = [rigger](const io::RiggedShape& shape, std::string& why_not) -> std::optional<rigging::ProposedJoints> {
    try {
      const Found found = rigger->find(shape);
      const std::string text = agreement_text(found.agreement);
      if (found.agreement >= kTrustedAgreement) return rigging::ProposedJoints{found.skeleton, "flows, " + text};
      why_not = "flows are unsure: " + text;
    } catch (const Interrupted&) {
      throw;
    } catch (const Error& error) {
      why_not = error.what();
    }
    return std::nullopt;
  };
  return steps;
}

}  // namespace anigen::generate
