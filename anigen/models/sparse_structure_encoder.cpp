#include "anigen/models/sparse_structure_encoder.h"

#include <array>

#include "anigen/core/error.h"
#include "anigen/models/sparse_structure_volumes.h"
#include "anigen/nn/shape_text.h"

namespace anigen::models {

using torch::Tensor;

SparseStructureEncoderImpl::SparseStructureEncoderImpl(const SparseStructureEncoderOptions& options, nn::Init init)
    : SparseStructureCoder(options), options_(options) {
  options.validate();
  const std::array<Stream*, 2> streams{&shape_, &skeleton_};
  const std::array<std::string, 2> suffix{"", "_skl"};
  const std::vector<std::int64_t>& widths = options.channels;
  // Layer by layer for both streams: the order of published state dicts.
  for (std::size_t s = 0; s < 2; ++s) {
    const std::int64_t in = s == 0 ? options.in_channels : options.in_channels_skl;
    streams[s]->input = register_module("input_layer" + suffix[s], nn::Conv3d(in, widths.front(), 3, 1, 1));
  }
  for (std::size_t s = 0; s < 2; ++s) {
    VolumeTorso blocks;
    for (std::size_t level = 0; level < widths.size(); ++level) {
      blocks->add_res_blocks(options.num_res_blocks, widths[level]);
      if (level + 1 < widths.size()) blocks->add_downsample(widths[level], widths[level + 1]);
    }
    streams[s]->blocks = register_module("blocks" + suffix[s], blocks);
  }
  for (std::size_t s = 0; s < 2; ++s) {
    VolumeTorso middle;
    middle->add_res_blocks(options.num_res_blocks_middle, widths.back());
    streams[s]->middle = register_module("middle_block" + suffix[s], middle);
  }
  for (std::size_t s = 0; s < 2; ++s) {
    const bool skeleton = s == 1;
    const bool deterministic = skeleton ? options.latent_denoising_skl : options.latent_denoising;
    const std::int64_t latent =
        (deterministic ? 1 : 2) * (skeleton ? options.latent_channels_skl : options.latent_channels);
    if (skeleton ? options.encode_global_skl : options.encode_global) {
      streams[s]->tokens = GlobalTokenEncoder(*this, skeleton, token_sizes(options, skeleton, widths.back(), latent));
    } else {
      streams[s]->out =
          register_module("out_layer" + suffix[s], VolumeHead(widths.back(), latent, norm_kind(options.norm_type)));
    }
  }
  if (init == nn::Init::kPublished) {
    initialize_volume_layers(*this);
    nn::kaiming_uniform_linears(*this);
    for (Stream* stream : streams) stream->tokens.initialize();
  }
  if (options.freezes()) apply_freezing();
}

Tensor SparseStructureEncoderImpl::run(Stream& stream, const Tensor& x, std::int64_t channels) {
  const std::int64_t factor = options_.downsampling();
  bool fits = x.dim() == 5 && x.size(1) == channels;
  for (std::int64_t axis = 2; fits && axis < 5; ++axis) fits = x.size(axis) > 0 && x.size(axis) % factor == 0;
  if (!fits) {
    throw InputError("", "",
                     "an occupancy grid must be [B, " + std::to_string(channels) + ", R, R, R] with R a multiple of " +
                         std::to_string(factor) + ", found " + nn::shape_text(x));
  }
  const torch::Dtype dtype = stream.input->weight.scalar_type();
  const Tensor h = stream.middle->forward(stream.blocks->forward(stream.input->forward(x.to(dtype)))).to(dtype);
  return stream.tokens.present() ? stream.tokens.forward(h) : stream.out->forward(h);
}

SparseStructureEncoderImpl::Latent SparseStructureEncoderImpl::latent_of(const Tensor& raw, bool deterministic,
                                                                         bool normalize, const Tensor& noise) const {
  const std::int64_t axis = channel_axis(raw);
  if (deterministic) {
    const Tensor z = normalize ? options_.normalize_scale * unit_latents(raw) : raw;
    return {z, z.detach(), torch::zeros_like(z)};
  }
  const std::vector<Tensor> halves = raw.chunk(2, axis);
  const Tensor &mean = halves[0], &logvar = halves[1];
  if (!noise.defined()) return {mean, mean, logvar};
  if (noise.sizes() != mean.sizes()) {
    throw InputError("", "", "noise " + nn::shape_text(noise) + " does not fit latents " + nn::shape_text(mean));
  }
  return {mean + torch::exp(0.5 * logvar) * noise.to(mean.options()), mean, logvar};
}

SparseStructureEncoderImpl::Latent SparseStructureEncoderImpl::encode_shape(const Tensor& x, const Tensor& noise) {
  return latent_of(run(shape_, x, options_.in_channels), options_.latent_denoising, options_.normalize_z, noise);
}

SparseStructureEncoderImpl::Latent SparseStructureEncoderImpl::encode_skeleton(const Tensor& x_skl,
                                                                               const Tensor& noise) {
  return latent_of(run(skeleton_, x_skl, options_.in_channels_skl), options_.latent_denoising_skl,
                   options_.normalize_z_skl, noise);
}

SparseStructureEncoderImpl::Output SparseStructureEncoderImpl::forward(const Tensor& x, const Tensor& x_skl,
                                                                       const PosteriorNoise* noise) {
  if (noise != nullptr) {
    const bool missing = (!options_.latent_denoising && !noise->z.defined()) ||
                         (!options_.latent_denoising_skl && !noise->z_skl.defined());
    if (missing) throw InputError("", "", "a sampled posterior needs noise");
  }
  const Latent shape = encode_shape(x, noise == nullptr ? Tensor() : noise->z);
  const Latent skeleton = encode_skeleton(x_skl, noise == nullptr ? Tensor() : noise->z_skl);
  return {shape.z, shape.mean, shape.logvar, skeleton.z, skeleton.mean, skeleton.logvar};
}

std::vector<std::int64_t> SparseStructureEncoderImpl::latent_shape(std::int64_t batch, std::int64_t resolution,
                                                                   bool skeleton) const {
  const std::int64_t channels = skeleton ? options_.latent_channels_skl : options_.latent_channels;
  if (skeleton ? options_.encode_global_skl : options_.encode_global) {
    return {batch, skeleton ? options_.global_token_num_skl : options_.global_token_num, channels};
  }
  const std::int64_t edge = resolution / options_.downsampling();
  return {batch, channels, edge, edge, edge};
}

}  // namespace anigen::models
