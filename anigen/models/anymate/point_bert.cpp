#include "anigen/models/anymate/point_bert.h"

#include <memory>

#include "anigen/models/anymate/checks.h"
#include "anigen/models/anymate/init.h"
#include "anigen/models/anymate/point_groups.h"
#include "anigen/nn/module_list.h"

namespace anigen::models::anymate {
namespace {

constexpr std::int64_t kPositionHidden = 128;

}  // namespace

PointBertImpl::PointBertImpl(const PointBertOptions& options, nn::Init init) : options_(options) {
  require(options.point_dims >= 3, "point_dims", "a point has at least its position");
  require(options.depth >= 0, "depth", "must not be negative");
  const std::int64_t width = options.trans_dim;
  cls_token_ = register_parameter("cls_token", torch::empty({1, 1, width}));
  cls_pos_ = register_parameter("cls_pos", torch::empty({1, 1, width}));
  encoder_ = register_module("encoder", MiniPointNet(options.point_dims, options.encoder_dims));
  reduce_dim_ = register_module("reduce_dim", nn::Linear(options.encoder_dims, width));
  pos_embed_ = register_module("pos_embed", ErfMlp(3, kPositionHidden, width, "0", "2"));
  const auto blocks = register_module("blocks", std::make_shared<torch::nn::Module>());
  for (std::int64_t i = 0; i < options.depth; ++i) {
    const double share = options.depth > 1 ? static_cast<double>(i) / static_cast<double>(options.depth - 1) : 0.0;
    blocks_.emplace_back(width, options.num_heads, options.drop_path_rate * share);
  }
  blocks->register_module("blocks", nn::module_list(blocks_));
  norm_ = register_module("norm", nn::AffineLayerNorm(width, kNormEps));
  if (init == nn::Init::kNone) return;
  default_layers(*this);
  torch::nn::init::zeros_(cls_token_);
  torch::nn::init::normal_(cls_pos_);
}

PointGroups PointBertImpl::grouped(const Tensor& points, const Tensor& start) const {
  require(points.defined() && points.dim() == 3 && points.size(-1) >= 3, "points_cloud", "must be [B, N, 3 or more]");
  const std::int64_t items = points.size(0), n = points.size(1);
  // The encoder was trained on clouds in a ball of half the size, with colours, which Anymate's clouds do not have.
  const Tensor positions = points.slice(-1, 0, 3) / 2.0;
  Tensor first = start;
  if (!first.defined()) {
    first = is_training() ? torch::randint(n, {items}, torch::kInt64) : torch::zeros({items}, torch::kInt64);
  }
  PointGroups groups;
  groups.centers = rows_of_items(positions, farthest_points(positions, options_.num_group, first));
  groups.rows = nearest_points(positions, groups.centers, options_.group_size);
  const Tensor offsets = rows_of_items(positions, groups.rows) - groups.centers.unsqueeze(2);
  groups.points = torch::constant_pad_nd(offsets, {0, options_.point_dims - 3});
  return groups;
}

Tensor PointBertImpl::tokens(const PointGroups& groups, const Tensor& features) {
  const std::int64_t items = features.size(0);
  Tensor x = torch::cat({cls_token_.expand({items, -1, -1}), reduce_dim_(features)}, 1);
  const Tensor positions = torch::cat({cls_pos_.expand({items, -1, -1}), pos_embed_(groups.centers)}, 1);
  for (VitBlock& block : blocks_) x = block->forward(x + positions);  // positions again before every block
  return norm_(x);
}

Tensor PointBertImpl::forward(const Tensor& points, const Tensor& start) {
  const PointGroups groups = grouped(points, start);
  return tokens(groups, group_features(groups));
}

}  // namespace anigen::models::anymate
