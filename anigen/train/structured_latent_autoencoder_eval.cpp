// How well held-out assets come back out of the structured latents.
#include <algorithm>
#include <cmath>

#include "anigen/core/log.h"
#include "anigen/eval/surface/point_cloud_metrics.h"
#include "anigen/eval/surface/surface_samples.h"
#include "anigen/train/structured_latent_autoencoder_stage.h"
#include "anigen/train/tensor_mesh.h"

namespace anigen::train {
namespace {

using torch::Tensor;

constexpr std::uint64_t kSurfaceSeed = 0;

// Means over the assets for which there is a value.
class AssetMeans {
 public:
  void add(const std::string& name, double value) {
    for (Entry& entry : entries_) {
      if (entry.name != name) continue;
      entry.sum += value;
      ++entry.count;
      return;
    }
    entries_.push_back({name, value, 1});
  }
  Values values() const {
    Values means;
    for (const Entry& entry : entries_) means.emplace_back(entry.name, entry.sum / static_cast<double>(entry.count));
    return means;
  }

 private:
  struct Entry {
    std::string name;
    double sum;
    std::size_t count;
  };
  std::vector<Entry> entries_;
};

// Evenly spaced rows where there are more than wanted; undefined: all.
Tensor evenly_chosen(std::int64_t rows, std::int64_t wanted, torch::Device device) {
  if (wanted == 0 || rows <= wanted) return Tensor();
  return (torch::arange(wanted, torch::kInt64) * rows).floor_divide(wanted).to(device);
}

}  // namespace

StructuredLatentAutoEncoderStage::Reconstruction StructuredLatentAutoEncoderStage::reconstruct(std::size_t index) {
  const torch::NoGradGuard no_grad;
  const auto batch = held_out_->load({{index, static_cast<std::uint64_t>(index)}});
  Reconstruction made;
  made.id = batch->ids.front();
  made.inputs = inputs_of(dynamic_cast<const loaders::FeatureSkeletonBatch&>(*batch));
  made.latents = encode(made.inputs, nullptr);
  made.decoded = decoder_->forward(streams_of(made.latents), made.inputs.skeletons);
  made.meshes = decoder_->extract_meshes(made.decoded, /*training=*/false);
  // Votes that nothing trained may be as many joints as there are voxels.
  made.grouped =
      options_.variant.geometry_only
          ? made.inputs.skeletons.front()
          : fields::group_votes(models::for_grouping(made.decoded.skeletons.front(), options_.variant.confidence),
                                coders_.decoder.grouping_strategy);
  return made;
}

Values StructuredLatentAutoEncoderStage::evaluate() {
  if (!held_out_) return {};
  const torch::NoGradGuard no_grad;
  const auto most = static_cast<std::size_t>(options_.eval_max_assets);
  const std::size_t count = most == 0 ? held_out_->size() : std::min(most, held_out_->size());
  const auto samples = static_cast<std::size_t>(options_.eval_surface_points);
  AssetMeans means;
  for (std::size_t i = 0; i < count; ++i) {
    const Reconstruction made = reconstruct(i);
    const fields::ExtractedMesh& mesh = made.meshes.front();
    means.add("surfaces", mesh.success ? 1.0 : 0.0);
    if (mesh.success) {
      const Mesh decoded = mesh_of(mesh.vertices, mesh.faces);
      const Mesh truth = mesh_of(made.inputs.rigs.vertices.front(), made.inputs.rigs.faces.front());
      const eval::SurfaceSamples of_decoded = eval::sample_mesh(decoded, samples, kSurfaceSeed, "decoded surface");
      const eval::SurfaceSamples of_truth = eval::sample_mesh(truth, samples, kSurfaceSeed, "true surface");
      means.add("chamfer", eval::chamfer_l1(eval::cloud_distances(of_decoded.points, of_truth.points)));
    }
    if (options_.variant.geometry_only) continue;
    const Tensor chosen =
        mesh.success ? evenly_chosen(mesh.vertices.size(0), options_.skin_vertices, device_) : Tensor();
    const models::RigLosses rig = compare_rigs(made.inputs, made.latents, made.decoded, made.meshes, {chosen});
    means.add("joints_loss", rig.joints.item<double>());
    means.add("parents_loss", rig.parents.item<double>());
    if (mesh.success && !made.inputs.is_bad_skin.front() && options_.rig.lambda_skin_kl > 0.0) {
      means.add("skin_kl_loss", rig.skin_kl.item<double>());
    }
    const std::vector<Eigen::Vector3d> truth = joint_positions(made.inputs.skeletons.front().joints);
    const std::vector<Eigen::Vector3d> grouped = joint_positions(made.grouped.joints);
    means.add("joint_count_error", std::abs(static_cast<double>(grouped.size()) - static_cast<double>(truth.size())));
    if (!grouped.empty()) means.add("joint_chamfer", eval::chamfer_l1(eval::cloud_distances(grouped, truth)));
    log::debug("held out {}: {} joints of {}", made.id, grouped.size(), truth.size());
  }
  return means.values();
}

}  // namespace anigen::train
