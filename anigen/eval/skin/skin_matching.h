#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/skin_weights.h"

namespace anigen::eval {

/// Predicted weights expressed in the true joints by a transport plan π between the joint measures (reference
/// training-and-data.md, 7.4 step 2): W̃ = W · diag(1/a) · π, where a are the plan's row sums (1/n each for uniform
/// measures, so W̃ = n W π). Soft: a joint split between two true ones hands on its weight in that proportion. Rows
/// sum to 1.
/// @param predicted_on_truth one row per true vertex, joints of the prediction; an empty row counts as weight 1 on
///        joint 0, as everywhere
/// @param plan [n, m], predicted joints × true joints, finite, not negative, no row without mass
/// @return row-major [V, m]
/// @throws InputError for a plan that is not such a one, or a weight on a joint that it does not have
std::vector<double> matched_weights(const SkinWeights& predicted_on_truth, const Eigen::MatrixXd& plan);

/// For score_skin(), which takes single precision: one rounding of each weight, at most 6e-8 of it, so an l1 or l2 is
/// off by at most 6e-8 (a row's weights sum to 1); the divergence by about 6e-8 too.
std::vector<float> single_precision(const std::vector<double>& weights);

/// The true joint that takes most of each predicted joint's mass; the lowest index of equals. [n]
/// @throws InputError as matched_weights()
std::vector<int> strongest_match(const Eigen::MatrixXd& plan);

}  // namespace anigen::eval
