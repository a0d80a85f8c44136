#include "anigen/models/anymate/joint_regression.h"

#include <tuple>

#include "anigen/models/anymate/checks.h"
#include "anigen/models/anymate/init.h"

namespace anigen::models::anymate {
namespace {

constexpr double kJointQueryDeviation = 0.02;

}  // namespace

JointRegressionImpl::JointRegressionImpl(const HeadOptions& options, std::int64_t num_joints, std::int64_t out_channels,
                                         nn::Init init)
    : width_(options.width) {
  require(num_joints > 0, "num_joints", "must be positive");
  query_ = register_parameter("query", torch::empty({num_joints, options.width}));
  cross_attn_decoder_ =
      register_module("cross_attn_decoder", ResidualCrossAttention(options.width, options.heads, options.qkv_bias));
  ln_post_ = register_module("ln_post", nn::AffineLayerNorm(options.width, kNormEps));
  output_proj_ = register_module("output_proj", nn::Linear(options.width, out_channels));
  if (init == nn::Init::kNone) return;
  default_layers(*this);
  normal_blocks(*this, options.init_scale);
  torch::nn::init::normal_(query_, 0.0, kJointQueryDeviation);
}

Tensor JointRegressionImpl::forward(const Tensor& latents) {
  require_shape(latents, {-1, -1, width_}, "latents");
  const Tensor queries = query_.unsqueeze(0).expand({latents.size(0), -1, -1});
  return output_proj_(ln_post_(cross_attn_decoder_(queries, latents)));
}

Tensor joint_chamfer_loss(const Tensor& predicted, const Tensor& joints, const std::vector<std::int64_t>& counts) {
  require_shape(predicted, {-1, -1, 3}, "predicted");
  require_shape(joints, {predicted.size(0), -1, 3}, "joints");
  require(static_cast<std::int64_t>(counts.size()) == predicted.size(0), "joints_num", "must be one for each item");
  std::vector<Tensor> items;
  for (std::size_t b = 0; b < counts.size(); ++b) {
    require(counts[b] >= 1 && counts[b] <= joints.size(1), "joints_num", "is not between 1 and the padded number");
    const auto item = static_cast<std::int64_t>(b);
    const Tensor truth = joints[item].narrow(0, 0, counts[b]);
    const Tensor distance = (predicted[item].unsqueeze(1) - truth.unsqueeze(0)).norm(2, -1);
    items.push_back(0.5 * (std::get<0>(distance.min(1)).mean() + std::get<0>(distance.min(0)).mean()));
  }
  return torch::stack(items).mean();
}

}  // namespace anigen::models::anymate
