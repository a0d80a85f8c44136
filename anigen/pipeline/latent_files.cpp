#include "anigen/pipeline/latent_files.h"

#include "anigen/core/error.h"
#include "anigen/io/npz.h"
#include "anigen/models/tensor_arrays.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;
using sparse::SparseTensor;
using torch::Tensor;

Tensor finite(const Tensor& latent, const fs::path& maker) {
  const Tensor values = latent.detach().to(torch::kCPU, torch::kFloat32).contiguous();
  if (!torch::isfinite(values).all().item<bool>()) {
    throw InputError(maker.string(), "", "this model gives a latent that is not finite");
  }
  return values;
}

// Voxel indices as files hold them: below 256.
Tensor byte_coords(const SparseTensor& latent) {
  return latent.support->coords().slice(1, 1).to(torch::kUInt8).contiguous();
}

}  // namespace

void write_structure_latents(const fs::path& file, const Tensor& shape, const Tensor& skeleton, const fs::path& maker) {
  io::write_npz(file, {{"mean", models::to_array(finite(shape, maker))},
                       {"mean_skl", models::to_array(finite(skeleton, maker))}});
}

void write_structured_latents(const fs::path& file, const models::PerStream<SparseTensor>& latents,
                              const fs::path& maker) {
  TORCH_CHECK(latents.geometry.support->items().items() == 1 && latents.skeleton.support->items().items() == 1,
              "structured latents of several assets in one file");
  const Tensor feats = torch::cat({finite(latents.geometry.feats, maker), finite(latents.skin.feats, maker)}, 1);
  io::write_npz(file, {{"coords", models::to_array(byte_coords(latents.geometry))},
                       {"feats", models::to_array(feats)},
                       {"coords_skl", models::to_array(byte_coords(latents.skeleton))},
                       {"feats_skl", models::to_array(finite(latents.skeleton.feats, maker))}});
}

}  // namespace anigen::pipeline
