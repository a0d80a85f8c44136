#pragma once
#include <vector>

#include "anigen/sparse/support.h"
#include "anigen/structured_latent/flow.h"
#include "benchmarks/flop_count.h"

namespace anigen::structured_latent {

/// Counts of voxels that decide the cost of a pass; one entry per resolution, the finest first,
/// each half as fine as the one before.
struct VoxelCounts {
  std::vector<double> voxels;
  std::vector<double> taps;         ///< Σ over voxels of how many of the 27 places around and at it exist
  std::vector<double> item_voxels;  ///< of each item, at the coarsest resolution: the tokens that attend to each other
};

inline constexpr double kSlatFlowTimeFeatures = 256.0;

/// Blocks around the transformer, there and back.
inline nn::FlopCount residual_flops(const StructuredLatentFlowStreamOptions& stream, bool skips,
                                    const VoxelCounts& voxels) {
  nn::FlopCount count;
  const auto items = static_cast<double>(voxels.item_voxels.size());
  const auto width = static_cast<double>(stream.model_channels);
  // A skip through a linear layer is formed at the lower resolution when the block changes it.
  const auto add = [&](double in, double out, std::size_t level, std::size_t skip_level) {
    count.convolution += 2.0 * voxels.taps[level] * out * (in + out);
    count.linear += nn::linear_flops(items, width, 2.0 * out);
    if (in != out) count.linear += nn::linear_flops(voxels.voxels[skip_level], in, out);
  };
  std::vector<double> widths;
  for (std::int64_t level = 0; level < stream.levels(); ++level)
    widths.push_back(static_cast<double>((*stream.io_block_channels)[static_cast<std::size_t>(level)]));
  widths.push_back(width);
  const double both = skips ? 2.0 : 1.0;
  for (std::size_t level = 0; level + 1 < widths.size(); ++level) {
    for (std::int64_t i = 1; i < stream.num_io_res_blocks; ++i) {
      add(widths[level], widths[level], level, level);
      add(both * widths[level], widths[level], level, level);
    }
    add(widths[level], widths[level + 1], level + 1, level + 1);
    add(both * widths[level + 1], widths[level], level, level + 1);
  }
  return count;
}

/// Layers around the blocks of a stream: input, output, time and joint count.
inline nn::FlopCount outer_flops(const StructuredLatentFlowOptions& options,
                                 const StructuredLatentFlowStreamOptions& stream, bool counts_joints,
                                 const VoxelCounts& voxels) {
  nn::FlopCount count;
  const auto items = static_cast<double>(voxels.item_voxels.size());
  const auto c = static_cast<double>(stream.model_channels);
  const double outer = stream.levels() > 0 ? static_cast<double>(stream.io_block_channels->front()) : c;
  count.linear +=
      nn::linear_flops(voxels.voxels[0], static_cast<double>(stream.in_channels + stream.out_channels), outer);
  count.linear += nn::linear_flops(items, kSlatFlowTimeFeatures + c, c);
  if (options.share_mod) count.linear += nn::linear_flops(items, c, 6.0 * c);
  if (counts_joints)
    count.linear += nn::linear_flops(items, 2.0 * static_cast<double>(options.joint_num_fourier_bands) + c, c);
  return count;
}

inline nn::CrossBlockSize slat_block_size(const StructuredLatentFlowOptions& options,
                                          const StructuredLatentFlowStreamOptions& stream, const VoxelCounts& voxels,
                                          const std::vector<double>& context, double context_channels) {
  nn::CrossBlockSize size;
  size.items = static_cast<double>(voxels.item_voxels.size());
  size.tokens = voxels.voxels.back();
  size.channels = static_cast<double>(stream.model_channels);
  size.context_channels = context_channels;
  for (std::size_t i = 0; i < voxels.item_voxels.size(); ++i) {
    size.context_tokens += context[i];
    size.attended += voxels.item_voxels[i] * (voxels.item_voxels[i] + context[i]);
  }
  size.hidden = nn::hidden_channels(size.channels, options.mlp_ratio);
  size.own_modulation = !options.share_mod;
  return size;
}

/// @param levels how often the resolution is halved
inline VoxelCounts count_voxels(const sparse::Support& support, std::int64_t levels) {
  VoxelCounts counts;
  const sparse::Support* at = &support;
  for (std::int64_t level = 0; level <= levels; ++level) {
    if (level > 0) at = at->coarsened(2).support.get();
    counts.voxels.push_back(static_cast<double>(at->size()));
    counts.taps.push_back(static_cast<double>((at->neighbours() >= 0).sum().item<std::int64_t>()));
  }
  for (const std::int64_t length : at->items().lengths()) counts.item_voxels.push_back(static_cast<double>(length));
  return counts;
}

/// Of one forward pass of a structured-latent flow, all items together.
/// @param shape, skeleton counted with the levels of their streams; as many items
/// @param condition_tokens of each item
inline nn::FlopCount forward_flops(const StructuredLatentFlowOptions& options, const VoxelCounts& shape,
                                   const VoxelCounts& skeleton, std::int64_t condition_tokens) {
  const std::vector<double> condition(shape.item_voxels.size(), static_cast<double>(condition_tokens));
  const double geo = static_cast<double>(options.geometry.model_channels);
  const double skin = static_cast<double>(options.skin.model_channels);
  const double skl = static_cast<double>(options.skeleton.model_channels);
  nn::FlopCount block = nn::cross_block_flops(
      slat_block_size(options, options.geometry, shape, condition, static_cast<double>(options.cond_channels)));
  block += nn::cross_block_flops(slat_block_size(options, options.skin, shape, skeleton.item_voxels, skl));
  block += nn::cross_block_flops(slat_block_size(options, options.skeleton, skeleton, shape.item_voxels, skin));
  block.linear += nn::linear_flops(shape.voxels.back(), geo, skin);
  nn::FlopCount count;
  for (std::int64_t i = 0; i < options.num_blocks; ++i) count += block;
  const bool joints = options.use_joint_num_cond;
  count += outer_flops(options, options.geometry, false, shape);
  count += outer_flops(options, options.skin, joints, shape);
  count += outer_flops(options, options.skeleton, joints, skeleton);
  for (const StructuredLatentFlowStreamOptions* stream : {&options.geometry, &options.skin})
    count += residual_flops(*stream, options.use_skip_connection, shape);
  count += residual_flops(options.skeleton, options.use_skip_connection, skeleton);
  return count;
}

}  // namespace anigen::structured_latent
