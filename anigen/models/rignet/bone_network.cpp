#include "anigen/models/rignet/bone_network.h"

namespace anigen::models::rignet {
namespace {

using Widths = std::vector<std::int64_t>;

}  // namespace

BoneNetworkImpl::BoneNetworkImpl(const RignetOptions& options) {
  const auto wide = [&](std::int64_t published) { return options.wide(published); };
  const std::int64_t shape = wide(64), joints = wide(128), pair = wide(256);
  shape_ = register_module("shape", ShapeCode(options, shape));
  near_ = register_module("near", SetAbstraction(0.999, 0.4, Widths{3, wide(64), wide(64), joints}));
  far_ = register_module("far", SetAbstraction(0.33, 0.6, Widths{joints + 3, wide(128), wide(128), wide(256)}));
  joints_ =
      register_module("joints", DenseStack(Widths{wide(256) + 3, wide(256), wide(256), wide(512), wide(256), joints}));
  pair_ = register_module("pair", DenseStack(Widths{8, wide(32), wide(64), wide(128), pair}));
  head_ = register_module("head", DenseStack(Widths{shape + joints + pair, wide(128), wide(64)}));
  dropout_ = register_module("dropout", torch::nn::Dropout(options.dropout));
  last_ = register_module("last", nn::Linear(wide(64), 1));
}

Tensor BoneNetworkImpl::judged(const Tensor& codes, const Tensor& from, const Tensor& to, const Tensor& inside) {
  const Tensor seen = torch::cat({from, to, (from - to).norm(2, 1, true), inside.unsqueeze(1)}, 1);
  return last_(dropout_(head_(torch::cat({codes, pair_(seen)}, 1)))).squeeze(1);
}

Tensor BoneNetworkImpl::forward(const ConnectivityInput& input) {
  if (input.first.size(0) == 0) return torch::zeros({0}, input.joints.positions.options());
  const SetAbstractionImpl::Result near = near_(input.joints, Tensor()), far = far_(near.centres, near.features);
  const Tensor joints = run_maxima(joints_(with_positions(far.features, far.centres)), far.centres.starts);
  const Tensor of_mesh = torch::cat({shape_(input.graph), joints}, 1);
  const Tensor mesh = run_of_rows(input.joints.starts).index_select(0, input.first);
  const Tensor codes = of_mesh.index_select(0, mesh);
  const Tensor a = input.joints.positions.index_select(0, input.first);
  const Tensor b = input.joints.positions.index_select(0, input.second);
  if (!is_training()) return 0.5 * (judged(codes, a, b, input.inside) + judged(codes, b, a, input.inside));
  const Tensor swap = (torch::rand({a.size(0), 1}) < 0.5).to(a.device());
  return judged(codes, torch::where(swap, b, a), torch::where(swap, a, b), input.inside);
}

}  // namespace anigen::models::rignet
