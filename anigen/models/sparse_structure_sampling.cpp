#include "anigen/models/sparse_structure_sampling.h"

#include <utility>

namespace anigen::models {
namespace {

constexpr double kStructureStrength = 7.5;

}  // namespace

using torch::Tensor;

SparseStructureFlowStageOptions SparseStructureFlowStageOptions::read(ConfigReader& args) {
  SparseStructureFlowStageOptions options;
  options.read_flow(args, kStructureStrength);
  return options;
}

flow::Velocities structure_velocities(SparseStructureFlow model, const Tensor& condition, bool guided) {
  const auto velocity_under = [model = std::move(model)](const Tensor& tokens) {
    return [model, tokens](const flow::Streams& x, float time) mutable {
      const Tensor t = torch::full({x[0].size(0)}, time, x[0].options());
      const Velocity velocity = model->forward(x[0], x[1], t, tokens);
      return flow::Streams{velocity.shape, velocity.skeleton};
    };
  };
  flow::Velocities velocities;
  velocities.conditional = velocity_under(condition);
  if (guided) velocities.unconditional = velocity_under(torch::zeros_like(condition));
  return velocities;
}

}  // namespace anigen::models
