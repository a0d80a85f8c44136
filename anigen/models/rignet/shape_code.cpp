#include "anigen/models/rignet/shape_code.h"

namespace anigen::models::rignet {

ShapeCodeImpl::ShapeCodeImpl(const RignetOptions& options, std::int64_t width) {
  const std::int64_t first = options.wide(64), second = options.wide(128), third = options.wide(256);
  units_ = register_module("units", GraphStack(std::vector<std::int64_t>{3, first, second, third}));
  whole_ = register_module("whole", DenseStack(std::vector<std::int64_t>{first + second + third, third, width}));
}

Tensor ShapeCodeImpl::forward(const MeshGraph& graph) {
  return run_maxima(whole_(units_(graph.vertices, graph)), graph.starts);
}

}  // namespace anigen::models::rignet
