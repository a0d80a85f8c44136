#include "anigen/sparse_structure/autoencoder.h"

#include <array>

#include "anigen/core/error.h"

namespace anigen::sparse_structure {

namespace {

nn::FreezableModel::Parts sparse_structure_parts(const SparseStructureCoderOptions& options) {
  nn::FreezableModel::Parts parts;
  parts.torso = {"blocks", "blocks_skl", "middle_block", "middle_block_skl"};
  parts.use_fp16 = options.use_fp16;
  parts.to_freeze = options.modules_to_freeze;
  return parts;
}

}  // namespace

SparseStructureCoder::SparseStructureCoder(const SparseStructureCoderOptions& options)
    : nn::FreezableModel(sparse_structure_parts(options)) {}

VolumeTorso SparseStructureCoder::registered_blocks(const std::string& suffix,
                                                    const SparseStructureCoderOptions& options, bool up) {
  const std::vector<std::int64_t>& widths = options.channels;
  VolumeTorso blocks;
  for (std::size_t level = 0; level < widths.size(); ++level) {
    blocks->add_res_blocks(options.num_res_blocks, widths[level]);
    if (level + 1 < widths.size()) blocks->add_resampler(widths[level], widths[level + 1], up);
  }
  return register_module("blocks" + suffix, blocks);
}

VolumeTorso SparseStructureCoder::registered_middle(const std::string& suffix,
                                                    const SparseStructureCoderOptions& options, std::int64_t channels) {
  VolumeTorso middle;
  middle->add_res_blocks(options.num_res_blocks_middle, channels);
  return register_module("middle_block" + suffix, middle);
}

template <typename Tokens>
void SparseStructureCoder::finish(const SparseStructureCoderOptions& options, nn::Init init, Stream<Tokens>& shape,
                                  Stream<Tokens>& skeleton) {
  if (init == nn::Init::kPublished) {
    initialize_volume_layers(*this);
    nn::kaiming_uniform_linears(*this);
    shape.tokens.initialize();
    skeleton.tokens.initialize();
  }
  if (options.freezes()) apply_freezing();
}

using torch::Tensor;

SparseStructureEncoderImpl::SparseStructureEncoderImpl(const SparseStructureEncoderOptions& options, nn::Init init)
    : SparseStructureCoder(options), options_(options) {
  options.validate();
  const std::int64_t finest = options.channels.front(), coarsest = options.channels.back();
  const std::array<Stream<GlobalTokenEncoder>*, 2> streams{&shape_, &skeleton_};
  for (auto* stream : streams) {
    const std::int64_t in = stream->skeleton ? options.in_channels_skl : options.in_channels;
    stream->input = register_module("input_layer" + stream->suffix, nn::Conv3d(in, finest, 3, 1, 1));
  }
  for (auto* stream : streams) stream->blocks = registered_blocks(stream->suffix, options, /*up=*/false);
  for (auto* stream : streams) stream->middle = registered_middle(stream->suffix, options, coarsest);
  for (auto* stream : streams) {
    const bool skeleton = stream->skeleton;
    const bool deterministic = skeleton ? options.latent_denoising_skl : options.latent_denoising;
    const std::int64_t latent =
        (deterministic ? 1 : 2) * (skeleton ? options.latent_channels_skl : options.latent_channels);
    if (skeleton ? options.encode_global_skl : options.encode_global) {
      stream->tokens = GlobalTokenEncoder(*this, skeleton, token_sizes(options, skeleton, coarsest, latent));
    } else {
      stream->out =
          register_module("out_layer" + stream->suffix, VolumeHead(coarsest, latent, norm_kind(options.norm_type)));
    }
  }
  finish(options, init, shape_, skeleton_);
}

Tensor SparseStructureEncoderImpl::run(Stream<GlobalTokenEncoder>& stream, const Tensor& x, std::int64_t channels) {
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

nn::Latent SparseStructureEncoderImpl::latent_of(const Tensor& raw, bool deterministic, bool normalize,
                                                 const Tensor& noise) const {
  if (!deterministic) return nn::sampled_latent(raw, channel_axis(raw), noise);
  return nn::deterministic_latent(normalize ? options_.normalize_scale * unit_latents(raw, options_.norm_order())
                                            : raw);
}

nn::Latent SparseStructureEncoderImpl::encode_shape(const Tensor& x, const Tensor& noise) {
  return latent_of(run(shape_, x, options_.in_channels), options_.latent_denoising, options_.normalize_z, noise);
}

nn::Latent SparseStructureEncoderImpl::encode_skeleton(const Tensor& x_skl, const Tensor& noise) {
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
  const nn::Latent shape = encode_shape(x, noise == nullptr ? Tensor() : noise->z);
  const nn::Latent skeleton = encode_skeleton(x_skl, noise == nullptr ? Tensor() : noise->z_skl);
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

SparseStructureDecoderImpl::SparseStructureDecoderImpl(const SparseStructureDecoderOptions& options, nn::Init init)
    : SparseStructureCoder(options), options_(options) {
  options.validate();
  const std::int64_t coarsest = options.channels.front(), finest = options.channels.back();
  const std::array<Stream<GlobalTokenDecoder>*, 2> streams{&shape_, &skeleton_};
  for (auto* stream : streams) {
    const bool skeleton = stream->skeleton;
    const std::int64_t latent = skeleton ? options.latent_channels_skl : options.latent_channels;
    if (skeleton ? options.encode_global_skl : options.encode_global) {
      stream->tokens = GlobalTokenDecoder(*this, skeleton, token_sizes(options, skeleton, coarsest, latent));
    } else {
      stream->input = register_module("input_layer" + stream->suffix, nn::Conv3d(latent, coarsest, 3, 1, 1));
    }
  }
  for (auto* stream : streams) stream->middle = registered_middle(stream->suffix, options, coarsest);
  for (auto* stream : streams) stream->blocks = registered_blocks(stream->suffix, options, /*up=*/true);
  for (auto* stream : streams) {
    const std::int64_t out = stream->skeleton ? options.out_channels_skl : options.out_channels;
    stream->out = register_module("out_layer" + stream->suffix, VolumeHead(finest, out, norm_kind(options.norm_type)));
  }
  finish(options, init, shape_, skeleton_);
}

Tensor SparseStructureDecoderImpl::run(Stream<GlobalTokenDecoder>& stream, const Tensor& z) {
  const bool skeleton = stream.skeleton;
  const std::int64_t channels = skeleton ? options_.latent_channels_skl : options_.latent_channels;
  const std::int64_t rank = stream.tokens.present() ? 3 : 5;
  if (z.dim() != rank || z.size(channel_axis(z)) != channels || z.numel() == 0) {
    throw InputError("", "",
                     "latents must be " + std::string(rank == 3 ? "[B, T, C]" : "[B, C, r, r, r]") +
                         " with C = " + std::to_string(channels) + ", found " + nn::shape_text(z));
  }
  const torch::Dtype dtype = stream.out->parameters().front().scalar_type();
  Tensor latents = z.to(dtype);
  if (skeleton ? options_.normalize_z_skl : options_.normalize_z)
    latents = options_.normalize_scale * unit_latents(latents, options_.norm_order());
  const Tensor cells = stream.tokens.present() ? stream.tokens.forward(latents) : stream.input->forward(latents);
  return stream.out->forward(stream.blocks->forward(stream.middle->forward(cells)).to(dtype));
}

Tensor SparseStructureDecoderImpl::decode_shape(const Tensor& z) { return run(shape_, z); }

Tensor SparseStructureDecoderImpl::decode_skeleton(const Tensor& z_skl) { return run(skeleton_, z_skl); }

SparseStructureDecoderImpl::Logits SparseStructureDecoderImpl::forward(const Tensor& z, const Tensor& z_skl) {
  return {decode_shape(z), decode_skeleton(z_skl)};
}

}  // namespace anigen::sparse_structure
