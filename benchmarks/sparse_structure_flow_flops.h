#pragma once
#include "anigen/sparse_structure/flow.h"
#include "benchmarks/flop_count.h"

namespace anigen::sparse_structure {

/// Sizes of one block, per batch item.
inline nn::CrossBlockSize block_size(const SparseStructureFlowOptions& options, double tokens, double channels,
                                     double context_tokens, double context_channels) {
  nn::CrossBlockSize size;
  size.tokens = tokens;
  size.channels = channels;
  size.context_tokens = context_tokens;
  size.context_channels = context_channels;
  size.attended = tokens * (tokens + context_tokens);
  size.hidden = nn::hidden_channels(channels, options.mlp_ratio);
  size.own_modulation = !options.share_mod;
  return size;
}

/// Of one forward pass. A backward pass through everything takes twice as many, one product per input and one per
/// weight, and more where activations are formed again.
/// @param batch B @param condition_tokens M
inline nn::FlopCount forward_flops(const SparseStructureFlowOptions& options, std::int64_t batch,
                                   std::int64_t condition_tokens) {
  constexpr double kTimeFeatures = 256.0;
  const auto ss = static_cast<double>(options.model_channels), skl = static_cast<double>(options.model_channels_skl);
  const auto n_ss = static_cast<double>(options.tokens()), n_skl = static_cast<double>(options.tokens_skl());
  const auto m = static_cast<double>(condition_tokens), k = static_cast<double>(options.cond_channels);
  nn::FlopCount count;
  for (const bool is_skeleton : {false, true}) {
    const double c = is_skeleton ? skl : ss, n = is_skeleton ? n_skl : n_ss;
    const bool global = is_skeleton ? options.z_skl_is_global : options.z_is_global;
    const auto side = static_cast<double>(global ? 1 : options.patch_size);
    const std::int64_t values =
        is_skeleton ? options.in_channels_skl + options.out_channels_skl : options.in_channels + options.out_channels;
    count.linear += nn::linear_flops(n, static_cast<double>(values) * side * side * side, c);
    count.linear += nn::linear_flops(1.0, kTimeFeatures + c, c);
    if (options.share_mod) count.linear += nn::linear_flops(1.0, c, 6.0 * c);
  }
  for (std::int64_t i = 0; i < options.num_blocks; ++i) {
    nn::CrossBlockSize shape = block_size(options, n_ss, ss, m, k);
    shape.self_rank = static_cast<double>(options.lora_rank_self(i));
    shape.cross_rank = static_cast<double>(options.lora_rank_cross(i));
    count += nn::cross_block_flops(shape);
    const bool from_ss = options.skl_cross_from_ss;
    count += nn::cross_block_flops(block_size(options, n_skl, skl, from_ss ? n_ss : m, from_ss ? ss : k));
    const bool crossing = options.has_cross_adapter(i), linear = !options.exchanges_by_attention();
    if (options.adapter_ss_to_skl && linear) count.linear += nn::linear_flops(n_skl, ss, skl);
    if (options.adapter_skl_to_ss && linear) count.linear += nn::linear_flops(n_ss, skl, ss);
    if (options.adapter_ss_to_skl && crossing) {
      count += nn::cross_block_flops(block_size(options, n_skl, skl, n_ss, ss));
      count.linear += nn::linear_flops(n_skl, skl, skl);
    }
    if (options.adapter_skl_to_ss && crossing) {
      count += nn::cross_block_flops(block_size(options, n_ss, ss, n_skl, skl));
      count.linear += nn::linear_flops(n_ss, ss, ss);
    }
  }
  count.linear *= static_cast<double>(batch);
  count.attention *= static_cast<double>(batch);
  return count;
}

}  // namespace anigen::sparse_structure
