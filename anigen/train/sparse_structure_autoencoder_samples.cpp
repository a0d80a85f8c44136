// Pictures of what the auto-encoder of the sparse structure reconstructs, and of what lies between two of its latents.
#include <algorithm>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/short_id.h"
#include "anigen/models/sparse_structure_volumes.h"
#include "anigen/models/voxel_sheet.h"
#include "anigen/train/sparse_structure_autoencoder_stage.h"

namespace anigen::train {
namespace {

using torch::Tensor;

constexpr std::size_t kSheetAssets = 8;
constexpr int kBetweenSteps = 5;

// On the way from a to b; latents of the unit sphere stay on their sphere.
Tensor latent_between(const Tensor& a, const Tensor& b, double share, bool on_sphere, double radius) {
  const Tensor z = torch::lerp(a, b, share);
  return on_sphere ? radius * models::unit_latents(z) : z;
}

}  // namespace

void SparseStructureAutoEncoderStage::sample(const std::filesystem::path& folder) {
  if (!held_out_ || held_out_->size() == 0) return;
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) throw Error(folder.string() + ": cannot create folder: " + error.message());

  std::vector<Reconstruction> made;
  std::vector<models::VoxelSheetRow> rows;
  for (std::size_t i = 0; i < std::min(kSheetAssets, held_out_->size()); ++i) {
    made.push_back(reconstruct(i));
    const Reconstruction& one = made.back();
    rows.push_back({short_id(one.id), {{one.shape, one.skeleton}, {one.decoded_shape, one.decoded_skeleton}}});
  }
  models::write_voxel_sheet(folder / "reconstructions.png", rows, {"ground truth", "reconstruction"});

  const torch::NoGradGuard no_grad;
  const models::SparseStructureEncoderOptions& coder = coders_.encoder;
  std::vector<models::VoxelSheetRow> strips;
  for (std::size_t i = 0; i + 1 < made.size(); i += 2) {
    const auto &a = made[i].latents, &b = made[i + 1].latents;
    models::VoxelSheetRow strip{short_id(made[i].id) + " to " + short_id(made[i + 1].id), {}};
    for (int step = 0; step < kBetweenSteps; ++step) {
      const double share = static_cast<double>(step) / (kBetweenSteps - 1);
      const Tensor z =
          latent_between(a.z, b.z, share, coder.latent_denoising && coder.normalize_z, coder.normalize_scale);
      const Tensor z_skl = latent_between(a.z_skl, b.z_skl, share, coder.latent_denoising_skl && coder.normalize_z_skl,
                                          coder.normalize_scale);
      const auto logits = decoder_->forward(z, z_skl);
      strip.cells.push_back({(logits.shape[0][0] > 0).to(torch::kCPU), (logits.skeleton[0][0] > 0).to(torch::kCPU)});
    }
    strips.push_back(std::move(strip));
  }
  if (!strips.empty()) models::write_voxel_sheet(folder / "between_latents.png", strips);
}

}  // namespace anigen::train
