#pragma once
#include <string>
#include <vector>

#include "anigen/sparse/support.h"

namespace anigen::sparse::cases {

/// Some voxels of a cube per item, in random order; the far corner of the cube is always one of the first item's, so
/// that all supports of a cube have the same extent.
inline Tensor random_voxels(const std::vector<std::int64_t>& counts, std::int64_t side) {
  std::vector<Tensor> items;
  for (std::size_t item = 0; item < counts.size(); ++item) {
    Tensor cells = torch::randperm(side * side * side - 1).narrow(0, 0, counts[item]);
    if (item == 0 && counts[0] > 0) cells[counts[0] / 2] = side * side * side - 1;
    const Tensor x = torch::floor_divide(cells, side * side), rest = cells - x * side * side;
    const Tensor y = torch::floor_divide(rest, side);
    items.push_back(torch::stack({torch::full_like(x, static_cast<std::int64_t>(item)), x, y, rest - y * side}, 1));
  }
  return torch::cat(items, 0).to(torch::kInt32);
}

inline SparseTensor random_sparse(const std::vector<std::int64_t>& counts, std::int64_t side, std::int64_t channels,
                                  torch::Dtype dtype = torch::kFloat32) {
  const SupportPtr support = Support::create(random_voxels(counts, side), static_cast<std::int64_t>(counts.size()));
  return {support, torch::randn({support->size(), channels}, torch::kFloat64).to(dtype)};
}

/// Draws every parameter: modules are built without initial values.
inline void draw_parameters(torch::nn::Module& module, torch::Dtype dtype) {
  module.to(dtype);
  const torch::NoGradGuard no_grad;
  for (Tensor& parameter : module.parameters()) parameter.normal_(0.0, 0.4);
}

/// Parameters of one module into those of the same names of another, with conversion.
inline void copy_parameters(const torch::nn::Module& from, torch::nn::Module& to) {
  const torch::NoGradGuard no_grad;
  const auto values = from.named_parameters();
  for (auto& entry : to.named_parameters()) entry.value().copy_(values[entry.key()]);
}

inline std::vector<std::string> parameter_keys(const torch::nn::Module& module) {
  std::vector<std::string> keys;
  for (const auto& entry : module.named_parameters()) keys.push_back(entry.key());
  return keys;
}

inline double distance(const Tensor& a, const Tensor& b) {
  return (a.to(torch::kFloat64) - b.to(torch::kFloat64)).abs().max().item<double>();
}

}  // namespace anigen::sparse::cases
