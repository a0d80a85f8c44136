#include "anigen/models/sparse_structure_flow_flops.h"

namespace anigen::models {
namespace {

// Sizes of one block, per batch item.
struct BlockSize {
  double tokens, channels, context_tokens, context_channels;
};

double linear_flops(double rows, double in, double out, double rank = 0.0) {
  return 2.0 * rows * in * out + 2.0 * rows * rank * (in + out);
}

FlopCount block_flops(const BlockSize& s, const SparseStructureFlowOptions& options, double self_rank,
                      double cross_rank) {
  const double n = s.tokens, c = s.channels, m = s.context_tokens;
  const auto hidden = static_cast<double>(static_cast<std::int64_t>(c * options.mlp_ratio));
  FlopCount count;
  count.linear += linear_flops(n, c, 3.0 * c, self_rank) + linear_flops(n, c, c, self_rank);
  count.linear += linear_flops(n, c, c, cross_rank) + linear_flops(m, s.context_channels, 2.0 * c, cross_rank) +
                  linear_flops(n, c, c, cross_rank);
  count.linear += linear_flops(n, c, hidden) + linear_flops(n, hidden, c);
  if (!options.share_mod) count.linear += linear_flops(1.0, c, 6.0 * c);
  count.attention = 4.0 * n * (n + m) * c;
  return count;
}

}  // namespace

FlopCount forward_flops(const SparseStructureFlowOptions& options, std::int64_t batch, std::int64_t condition_tokens) {
  constexpr double kTimeFeatures = 256.0;
  const auto ss = static_cast<double>(options.model_channels), skl = static_cast<double>(options.model_channels_skl);
  const auto n_ss = static_cast<double>(options.tokens()), n_skl = static_cast<double>(options.tokens_skl());
  const auto m = static_cast<double>(condition_tokens), k = static_cast<double>(options.cond_channels);
  FlopCount count;
  const auto add = [&count](const FlopCount& more) {
    count.linear += more.linear;
    count.attention += more.attention;
  };
  for (const bool is_skeleton : {false, true}) {
    const double c = is_skeleton ? skl : ss, n = is_skeleton ? n_skl : n_ss;
    const bool global = is_skeleton ? options.z_skl_is_global : options.z_is_global;
    const auto side = static_cast<double>(global ? 1 : options.patch_size);
    const std::int64_t values =
        is_skeleton ? options.in_channels_skl + options.out_channels_skl : options.in_channels + options.out_channels;
    count.linear += linear_flops(n, static_cast<double>(values) * side * side * side, c);
    count.linear += linear_flops(1.0, kTimeFeatures + c, c);
    if (options.share_mod) count.linear += linear_flops(1.0, c, 6.0 * c);
  }
  for (std::int64_t i = 0; i < options.num_blocks; ++i) {
    add(block_flops({n_ss, ss, m, k}, options, static_cast<double>(options.lora_rank_self(i)),
                    static_cast<double>(options.lora_rank_cross(i))));
    add(block_flops({n_skl, skl, options.skl_cross_from_ss ? n_ss : m, options.skl_cross_from_ss ? ss : k}, options,
                    0.0, 0.0));
    const bool crossing = options.has_cross_adapter(i), linear = !options.exchanges_by_attention();
    if (options.adapter_ss_to_skl && linear) count.linear += linear_flops(n_skl, ss, skl);
    if (options.adapter_skl_to_ss && linear) count.linear += linear_flops(n_ss, skl, ss);
    if (options.adapter_ss_to_skl && crossing) {
      add(block_flops({n_skl, skl, n_ss, ss}, options, 0.0, 0.0));
      count.linear += linear_flops(n_skl, skl, skl);
    }
    if (options.adapter_skl_to_ss && crossing) {
      add(block_flops({n_ss, ss, n_skl, skl}, options, 0.0, 0.0));
      count.linear += linear_flops(n_ss, ss, ss);
    }
  }
  count.linear *= static_cast<double>(batch);
  count.attention *= static_cast<double>(batch);
  return count;
}

}  // namespace anigen::models
