#include "anigen/models/rignet/root_network.h"

namespace anigen::models::rignet {
namespace {

using LayerWidths = std::vector<std::int64_t>;

}  // namespace

RootNetworkImpl::RootNetworkImpl(const RignetOptions& options) {
  const auto wide = [&](std::int64_t published) { return options.wide(published); };
  const std::int64_t shape = wide(128), near = wide(128), far = wide(256), all = wide(512);
  shape_ = register_module("shape", ShapeCode(options, shape));
  near_ = register_module("near", SetAbstraction(0.999, 0.4, LayerWidths{4, wide(64), wide(64), near}));
  far_ = register_module("far", SetAbstraction(0.33, 0.6, LayerWidths{near + 3, wide(128), wide(128), far}));
  all_ = register_module("all", DenseStack(LayerWidths{far + 3, wide(256), wide(256), all}));
  back_far_ = register_module("back_far", DenseStack(LayerWidths{all + far, wide(256), wide(256)}));
  back_near_ = register_module("back_near", DenseStack(LayerWidths{wide(256) + near, wide(256), wide(128)}));
  back_joints_ = register_module("back_joints", DenseStack(LayerWidths{wide(128) + 1, wide(128), wide(128)}));
  head_ = register_module("head", DenseStack(LayerWidths{shape + wide(128), wide(200), wide(64)}));
  last_ = register_module("last", nn::Linear(wide(64), 1));
}

Tensor RootNetworkImpl::forward(const ConnectivityInput& input) {
  const Tensor off_middle = input.joints.positions.narrow(1, 0, 1).abs();
  const SetAbstractionImpl::Result near = near_(input.joints, off_middle), far = far_(near.centres, near.features);
  const Tensor all = run_maxima(all_(with_positions(far.features, far.centres)), far.centres.starts);
  const Tensor at_far = back_far_(torch::cat({spread(all, far.centres.starts), far.features}, 1));
  const Tensor at_near = back_near_(torch::cat({interpolated(far.centres, at_far, near.centres), near.features}, 1));
  const Tensor at_joints = back_joints_(torch::cat({interpolated(near.centres, at_near, input.joints), off_middle}, 1));
  const Tensor shape = spread(shape_(input.graph), input.joints.starts);
  return last_(head_(torch::cat({shape, at_joints}, 1))).squeeze(1);
}

}  // namespace anigen::models::rignet
