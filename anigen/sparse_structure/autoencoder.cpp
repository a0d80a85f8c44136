#include "anigen/sparse_structure/autoencoder.h"

#include <array>

#include "anigen/core/error.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"
#include "anigen/sparse_structure/layers.h"

namespace anigen::sparse_structure {

namespace {

nn::StreamCoder::Parts sparse_structure_parts(const SparseStructureCoderOptions& options) {
  nn::StreamCoder::Parts parts;
  parts.torso = {"blocks", "blocks_skl", "middle_block", "middle_block_skl"};
  parts.use_fp16 = options.use_fp16;
  parts.to_freeze = options.modules_to_freeze;
  return parts;
}

}  // namespace

SparseStructureCoder::SparseStructureCoder(const SparseStructureCoderOptions& options)
    : nn::StreamCoder(sparse_structure_parts(options)) {}

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

using torch::Tensor;

SparseStructureDecoderImpl::SparseStructureDecoderImpl(const SparseStructureDecoderOptions& options, nn::Init init)
    : SparseStructureCoder(options), options_(options) {
  options.validate();
  const std::array<Stream*, 2> streams{&shape_, &skeleton_};
  const std::array<std::string, 2> suffix{"", "_skl"};
  const std::vector<std::int64_t>& widths = options.channels;
  // Layer by layer for both streams: the order of published state dicts.
  for (std::size_t s = 0; s < 2; ++s) {
    const bool skeleton = s == 1;
    const std::int64_t latent = skeleton ? options.latent_channels_skl : options.latent_channels;
    if (skeleton ? options.encode_global_skl : options.encode_global) {
      streams[s]->tokens = GlobalTokenDecoder(*this, skeleton, token_sizes(options, skeleton, widths.front(), latent));
    } else {
      streams[s]->input = register_module("input_layer" + suffix[s], nn::Conv3d(latent, widths.front(), 3, 1, 1));
    }
  }
  for (std::size_t s = 0; s < 2; ++s) {
    VolumeTorso middle;
    middle->add_res_blocks(options.num_res_blocks_middle, widths.front());
    streams[s]->middle = register_module("middle_block" + suffix[s], middle);
  }
  for (std::size_t s = 0; s < 2; ++s) {
    VolumeTorso blocks;
    for (std::size_t level = 0; level < widths.size(); ++level) {
      blocks->add_res_blocks(options.num_res_blocks, widths[level]);
      if (level + 1 < widths.size()) blocks->add_upsample(widths[level], widths[level + 1]);
    }
    streams[s]->blocks = register_module("blocks" + suffix[s], blocks);
  }
  for (std::size_t s = 0; s < 2; ++s) {
    const std::int64_t out = s == 0 ? options.out_channels : options.out_channels_skl;
    streams[s]->out =
        register_module("out_layer" + suffix[s], VolumeHead(widths.back(), out, norm_kind(options.norm_type)));
  }
  if (init == nn::Init::kPublished) {
    initialize_volume_layers(*this);
    nn::kaiming_uniform_linears(*this);
    for (Stream* stream : streams) stream->tokens.initialize();
  }
  if (options.freezes()) apply_freezing();
}

Tensor SparseStructureDecoderImpl::run(Stream& stream, const Tensor& z, bool skeleton) {
  const std::int64_t channels = skeleton ? options_.latent_channels_skl : options_.latent_channels;
  const std::int64_t rank = stream.tokens.present() ? 3 : 5;
  if (z.dim() != rank || z.size(channel_axis(z)) != channels || z.numel() == 0) {
    throw InputError("", "",
                     "latents must be " + std::string(rank == 3 ? "[B, T, C]" : "[B, C, r, r, r]") +
                         " with C = " + std::to_string(channels) + ", found " + nn::shape_text(z));
  }
  const torch::Dtype dtype = stream.out->parameters().front().scalar_type();
  Tensor latents = z.to(dtype);
  if (skeleton ? options_.normalize_z_skl : options_.normalize_z) {
    latents = options_.normalize_scale * unit_latents(latents);
  }
  const Tensor cells = stream.tokens.present() ? stream.tokens.forward(latents) : stream.input->forward(latents);
  return stream.out->forward(stream.blocks->forward(stream.middle->forward(cells)).to(dtype));
}

Tensor SparseStructureDecoderImpl::decode_shape(const Tensor& z) { return run(shape_, z, false); }

Tensor SparseStructureDecoderImpl::decode_skeleton(const Tensor& z_skl) { return run(skeleton_, z_skl, true); }

SparseStructureDecoderImpl::Logits SparseStructureDecoderImpl::forward(const Tensor& z, const Tensor& z_skl) {
  return {decode_shape(z), decode_skeleton(z_skl)};
}

SparseStructureEncoder load_sparse_structure_encoder(const nn::RunModel& found, torch::Device device) {
  return nn::load_trained<SparseStructureEncoder, SparseStructureEncoderOptions>(found, device);
}

SparseStructureDecoder load_sparse_structure_decoder(const nn::RunModel& found, torch::Device device) {
  return nn::load_trained<SparseStructureDecoder, SparseStructureDecoderOptions>(found, device);
}

SparseStructureFlow load_sparse_structure_flow(const nn::RunModel& found, torch::Device device) {
  return nn::load_trained<SparseStructureFlow, SparseStructureFlowOptions>(found, device);
}

}  // namespace anigen::sparse_structure
