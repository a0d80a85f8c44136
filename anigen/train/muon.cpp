#include "anigen/train/muon.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"

namespace anigen::train {
torch::Tensor orthogonalize(const torch::Tensor& matrix) {
  constexpr double kA = 3.4445, kB = -4.7750, kC = 2.0315;
  // Working on the wide orientation keeps the Gram matrix small.
  const bool tall = matrix.size(0) > matrix.size(1);
  torch::Tensor x = tall ? matrix.t() : matrix;
  x = x / (x.norm() + 1e-7);
  for (int i = 0; i < 5; ++i) {
    const torch::Tensor gram = x.mm(x.t());
    const torch::Tensor polynomial = torch::addmm(gram, gram, gram, kB, kC);
    x = torch::addmm(x, polynomial, x, kA, 1.0);
  }
  return tall ? x.t() : x;
}

Muon::Muon(const ParameterBuffer& buffer, const Options& options)
    : momentum(torch::zeros_like(buffer.master())), options_(options) {
  if (!(options.momentum >= 0.0 && options.momentum < 1.0)) {
    throw InputError("", "/trainer/args/optimizer/args/momentum", "must be in [0, 1)");
  }
  for (std::size_t i = 0; i < buffer.slots().size(); ++i) {
    const torch::Tensor& parameter = buffer.slots()[i].parameter;
    if (parameter.dim() == 2 && std::min(parameter.size(0), parameter.size(1)) >= options.min_side)
      matrices_.push_back(i);
  }
}

void Muon::step(ParameterBuffer& buffer, AdamW& rest, double gradient_factor, double lr) {
  const torch::NoGradGuard no_grad;
  const double beta = options_.momentum;
  std::vector<torch::Tensor> before;
  before.reserve(matrices_.size());
  for (const std::size_t i : matrices_) before.push_back(buffer.part(buffer.master(), buffer.slots()[i]).clone());
  // One pass of AdamW over everything is cheaper than gathering its parts; the matrices are then set back.
  rest.step(buffer.master(), buffer.gradient(), gradient_factor, lr);
  for (std::size_t k = 0; k < matrices_.size(); ++k) {
    const ParameterBuffer::Slot& slot = buffer.slots()[matrices_[k]];
    const torch::Tensor gradient = buffer.part(buffer.gradient(), slot) * gradient_factor;
    torch::Tensor average = buffer.part(momentum, slot);
    average.mul_(beta).add_(gradient, 1.0 - beta);
    const torch::Tensor direction = orthogonalize(gradient * (1.0 - beta) + average * beta);
    const double scale = 0.2 * std::sqrt(static_cast<double>(std::max(direction.size(0), direction.size(1))));
    torch::Tensor weight = buffer.part(buffer.master(), slot);
    weight.copy_(before[k].mul_(1.0 - lr * rest.options().weight_decay).add_(direction, -lr * scale));
  }
}

}  // namespace anigen::train
