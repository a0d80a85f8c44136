#pragma once
#include <cmath>
#include <string>

#include "anigen/anymate/model.h"

namespace anigen::anymate {

/// A model of the given names that is small enough to be run in a test.
inline ModelOptions small_model(const std::string& encoder, const std::string& decoder) {
  ModelOptions options = ModelOptions::released(encoder, decoder);
  constexpr std::int64_t kWidth = 24, kHeads = 2;
  options.head.width = kWidth;
  options.head.heads = kHeads;
  options.head.init_scale = 0.1;
  options.num_joints = 10;
  options.head_token_length = 6;
  options.token_layers = 2;
  options.concat_skinning.layers = 2;
  options.concat_skinning.concat_num = 8;
  options.concat_denoiser.width = kWidth;
  options.concat_denoiser.heads = kHeads;
  options.concat_denoiser.layers = 2;
  options.cross_denoiser.z_dim = kWidth;
  options.cross_denoiser.x_dim = 16;
  options.cross_denoiser.num_heads = kHeads;
  options.cross_denoiser.num_blocks = 2;
  options.cross_denoiser.num_compute_layers = 1;
  options.cross_denoiser.num_z = 3;
  options.cross_denoiser.num_latents = 4;
  options.triplane.z_dim = kWidth;
  options.triplane.w_dim = kWidth;
  options.triplane.img_resolution = 16;
  options.triplane.channel_base = 64;
  options.triplane.channel_max = 8;
  options.bert.trans_dim = 12;
  options.bert.num_heads = kHeads;
  options.bert.depth = 2;
  options.bert.num_group = 6;
  options.bert.group_size = 5;
  options.bert.encoder_dims = 16;
  options.projection = {12, 16, 16, kWidth};
  options.michelangelo.num_latents = 5;
  options.michelangelo.width = kWidth;
  options.michelangelo.heads = kHeads;
  options.michelangelo.embed_dim = 4;
  options.michelangelo.num_encoder_layers = 1;
  options.michelangelo.num_decoder_layers = 2;
  options.scratch.num_latents = 5;
  options.scratch.width = kWidth;
  options.scratch.heads = kHeads;
  options.scratch.num_encoder_layers = 1;
  return options;
}

/// Positions in [-1, 1] and unit normals, [B, N, 6].
inline Tensor small_cloud(std::int64_t items, std::int64_t points) {
  const Tensor normals = torch::randn({items, points, 3});
  return torch::cat({torch::rand({items, points, 3}) * 2.0 - 1.0, normals / normals.norm(2, -1, true)}, -1);
}

/// Largest difference of two tensors.
inline double apart(const Tensor& a, const Tensor& b) { return (a - b).abs().max().item<double>(); }

}  // namespace anigen::anymate
