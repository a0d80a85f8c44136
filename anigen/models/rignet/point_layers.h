#pragma once
#include <vector>

#include "anigen/models/rignet/dense_layers.h"
#include "anigen/models/rignet/point_sets.h"

namespace anigen::models::rignet {

/// A set abstraction of PointNet++ (Qi et al. 2017): around each centre the largest of MLP([x_j, p_j − p_i]). Keys
/// `mlp.*`.
class SetAbstractionImpl : public torch::nn::Module {
 public:
  /// @param widths of the MLP, the first being that of the features and 3 for the offsets
  SetAbstractionImpl(double ratio, double radius, const std::vector<std::int64_t>& widths);

  struct Result {
    PointSets centres;
    Tensor features;  ///< [centres, last width]
  };
  /// @param features [N, first width − 3], undefined where that is nothing @throws InputError for shapes
  Result forward(const PointSets& points, const Tensor& features);

 private:
  double ratio_, radius_;
  DenseStack mlp_ = nullptr;
};
TORCH_MODULE(SetAbstraction);

/// Features beside positions, for the MLP that codes whole sets. @param features [N, C] @return [N, C + 3]
Tensor with_positions(const Tensor& features, const PointSets& points);

}  // namespace anigen::models::rignet
