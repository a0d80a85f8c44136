#pragma once
#include <vector>

#include "anigen/models/rignet/graph_unit.h"
#include "anigen/models/rignet/options.h"

namespace anigen::models::rignet {

/// One code per mesh, as BoneNet and RootNet look at it: units of 64, 128 and 256, their outputs through 256 and a last
/// width, the largest over vertices (reference anymate-baselines.md, 9.3). Keys `units.*`, `whole.*`.
class ShapeCodeImpl : public torch::nn::Module {
 public:
  ShapeCodeImpl(const RignetOptions& options, std::int64_t width);  ///< @param width of the code
  Tensor forward(const MeshGraph& graph);                           ///< @return [B, width]

 private:
  GraphStack units_ = nullptr;
  DenseStack whole_ = nullptr;
};
TORCH_MODULE(ShapeCode);

}  // namespace anigen::models::rignet
