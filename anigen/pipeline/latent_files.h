#pragma once
#include <filesystem>

#include "anigen/models/stream_coder.h"
#include "anigen/nn/torch.h"
#include "anigen/sparse/sparse_tensor.h"

/// Latents of one asset as datasets hold them (reference data-preparation.md), whole or not at all.
/// @param maker the file that is to blame for a latent that is not finite @throws InputError naming it
namespace anigen::pipeline {

/// ss_latents/<model>/<id>.npz: mean and mean_skl. @param shape, skeleton [C, r, r, r]
void write_structure_latents(const std::filesystem::path& file, const torch::Tensor& shape,
                             const torch::Tensor& skeleton, const std::filesystem::path& maker);

/// latents/<model>/<id>.npz: coords u8 [N, 3] and feats f32 [N, C of geometry and skin], the same with _skl. Of a batch
/// of one.
void write_structured_latents(const std::filesystem::path& file, const models::PerStream<sparse::SparseTensor>& latents,
                              const std::filesystem::path& maker);

}  // namespace anigen::pipeline
