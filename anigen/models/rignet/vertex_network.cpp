#include "anigen/models/rignet/vertex_network.h"

#include "anigen/nn/init.h"

namespace anigen::models::rignet {

VertexNetworkImpl::VertexNetworkImpl(const RignetOptions& options, std::int64_t channels) {
  const std::int64_t first = options.wide(64), second = options.wide(256), third = options.wide(512);
  const std::int64_t all = first + second + third, code = options.wide(1024), late = options.wide(256);
  units_ = register_module("units", GraphStack(std::vector<std::int64_t>{3, first, second, third}));
  whole_ = register_module("whole", DenseStack(std::vector<std::int64_t>{all, code}));
  head_ = register_module("head", DenseStack(std::vector<std::int64_t>{code + 3 + all, code, late}));
  dropout_ = register_module("dropout", torch::nn::Dropout(options.dropout));
  last_ = register_module("last", nn::Linear(late, channels));
}

Tensor VertexNetworkImpl::forward(const MeshGraph& graph) {
  const Tensor local = units_(graph.vertices, graph);
  const Tensor code = spread(run_maxima(whole_(local), graph.starts), graph.starts);
  return last_(dropout_(head_(torch::cat({code, graph.vertices, local}, 1))));
}

void VertexNetworkImpl::zero_last() { nn::zero_parameters(*last_); }

}  // namespace anigen::models::rignet
