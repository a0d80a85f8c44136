#include "anigen/models/sparse_structure_decoder.h"

#include <array>

#include "anigen/core/error.h"
#include "anigen/models/sparse_structure_volumes.h"
#include "anigen/nn/shape_text.h"

namespace anigen::models {

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

}  // namespace anigen::models
