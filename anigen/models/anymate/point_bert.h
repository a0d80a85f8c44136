#pragma once
#include <vector>

#include "anigen/models/anymate/mini_point_net.h"
#include "anigen/models/anymate/vit_block.h"
#include "anigen/nn/init.h"

namespace anigen::models::anymate {

/// Arguments of the released encoder ("PointTransformer_8192point_2layer") under their own names.
struct PointBertOptions {
  std::int64_t trans_dim = 384, depth = 12, num_heads = 6;
  std::int64_t group_size = 32, num_group = 512;
  std::int64_t encoder_dims = 256;  ///< of a group before it becomes a token
  std::int64_t point_dims = 6;      ///< position and colour
  double drop_path_rate = 0.1;      ///< of the last block, while training
};

/// Groups of a point cloud.
struct PointGroups {
  Tensor centers;  ///< [B, G, 3]
  Tensor rows;     ///< [B, G, M] int64, members of each group, in no order
  Tensor points;   ///< [B, G, M, point_dims], positions relative to the centre, then what else a point has
};

/// Point-BERT (Yu et al. 2022) with the layout of PointLLM, which Anymate starts from (reference anymate-baselines.md,
/// 2.2). Keys `cls_token`, `cls_pos`, `encoder.*` (MiniPointNet), `reduce_dim.*`, `pos_embed.{0,2}.*`,
/// `blocks.blocks.<i>.*`, `norm.*`.
class PointBertImpl : public torch::nn::Module {
 public:
  explicit PointBertImpl(const PointBertOptions& options = {}, nn::Init init = nn::Init::kPublished);

  /// @param points [B, N, 3 or more], positions in [-1, 1]; further channels (normals) are not used
  /// @param start [B] int64, the first point that becomes a centre. Undefined: drawn from torch's default generator
  ///   while training, point 0 in evaluation, where the released code draws too
  /// @return [B, 1 + G, trans_dim], the class token first @throws InputError for other shapes and too few points
  Tensor forward(const Tensor& points, const Tensor& start = {});

  /// The steps of forward.
  PointGroups grouped(const Tensor& points, const Tensor& start = {}) const;
  Tensor group_features(const PointGroups& groups) { return encoder_(groups.points); }  ///< [B, G, encoder_dims]
  /// @param features of group_features @return [B, 1 + G, trans_dim]
  Tensor tokens(const PointGroups& groups, const Tensor& features);

  std::int64_t token_count() const { return options_.num_group + 1; }

 private:
  PointBertOptions options_;
  Tensor cls_token_, cls_pos_;
  MiniPointNet encoder_ = nullptr;
  nn::Linear reduce_dim_ = nullptr;
  ErfMlp pos_embed_ = nullptr;
  std::vector<VitBlock> blocks_;
  nn::AffineLayerNorm norm_ = nullptr;
};
TORCH_MODULE(PointBert);

}  // namespace anigen::models::anymate
