#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace anigen::eval {

/// Dense skin weights, one row per vertex, one column per joint. Row-major, so that a std::vector<double> [V, J] can be
/// passed without a copy (see skin_matrix()).
using SkinMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using SkinMatrixView = Eigen::Ref<const SkinMatrix>;

/// @throws InputError when there are not rows · joints values
Eigen::Map<const SkinMatrix> skin_matrix(const std::vector<double>& dense, std::size_t vertices, std::size_t joints);
SkinMatrix skin_matrix(const std::vector<float>& dense, std::size_t vertices, std::size_t joints);

/// @throws InputError unless both have the same shape, at least one vertex and one joint, and finite entries ≥ 0
void check_skin_pair(const SkinMatrixView& predicted, const SkinMatrixView& truth);

}  // namespace anigen::eval
