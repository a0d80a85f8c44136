#include "anigen/models/rignet/connectivity_network.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include "anigen/models/anymate/checks.h"

namespace anigen::models::rignet {
namespace {

constexpr double kHardest = 0.3;

}  // namespace

ConnectivityNetworkImpl::ConnectivityNetworkImpl(const RignetOptions& options) {
  bone_ = register_module("bone", BoneNetwork(options));
  root_ = register_module("root", RootNetwork(options));
}

Tensor hard_binary_loss(const Tensor& logits, const Tensor& truth) {
  anymate::require_shape(logits, {-1}, "logits");
  anymate::require_shape(truth, {logits.size(0)}, "truth");
  anymate::require(logits.size(0) > 0, "logits", "there are none");
  const Tensor each = torch::binary_cross_entropy_with_logits(logits, truth, {}, {}, at::Reduction::None);
  const auto hard = static_cast<std::int64_t>(std::ceil(kHardest * static_cast<double>(each.size(0))));
  return each.mean() + std::get<0>(each.topk(std::max<std::int64_t>(hard, 1))).mean();
}

ConnectivityChances connectivity_chances(const ConnectivityLogits& logits, const ConnectivityInput& input) {
  anymate::require(input.graph.meshes() == 1, "input", "must be of one mesh");
  const torch::NoGradGuard no_grad;
  const std::int64_t joints = input.joints.positions.size(0);
  const Tensor first = input.first.cpu(), second = input.second.cpu();
  Tensor bone = torch::zeros({joints, joints});
  bone.index_put_({first, second}, torch::sigmoid(logits.bone).to(torch::kCPU, torch::kFloat32));
  return {bone + bone.t(), torch::sigmoid(logits.root).to(torch::kCPU, torch::kFloat32)};
}

}  // namespace anigen::models::rignet
