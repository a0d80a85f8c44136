#pragma once
#include <functional>
#include <string>
#include <vector>

#include "anigen/eval/pairs.h"

namespace anigen::eval {

/// All return weights [V, J], row-major, rows summing to 1.

/// Weight 1 on the joint whose bone (see bone_segments()) is nearest by straight distance; the lower index wins ties.
std::vector<float> nearest_bone_weights(const GroundTruth& truth);

/// w_vj ∝ (d_vj + 1e-6)^-p, d the distance to the joint's bones in the normalised frame. The usual p of 2 or 4 spreads
/// weight over far joints, of which there are many: l1 falls as p grows. At 8 it is about that of the nearest bone,
/// which is the limit of p → ∞, and the divergence is much lower, since no weight is 0.
inline constexpr double kInverseDistancePower = 8.0;
std::vector<float> inverse_distance_weights(const GroundTruth& truth, double power = kInverseDistancePower);

/// Oracle: weight 1 on the joint with the largest true weight. What any hard assignment can reach at most in l1.
std::vector<float> strongest_joint_weights(const GroundTruth& truth);

/// Oracle: the closest matrix of a rank to the true weights in the Frobenius norm, W V_r V_rᵀ with V_r the r leading
/// eigenvectors of the J × J Gram matrix WᵀW (Eckart–Young); then negative entries become 0 and rows are divided by
/// their sum (a row with nothing left gets weight 1 on its largest entry). Before those two steps no linear code of r
/// numbers per vertex does better in the sum of squares; afterwards it is a good code, not a bound.
std::vector<float> low_rank_weights(const GroundTruth& truth, std::size_t rank = 4);

/// Oracle: every vertex is a convex mix of r weight rows shared by the asset, fitted by expectation–maximisation to
/// least Kullback–Leibler divergence (non-negative factorisation; probabilistic latent semantic analysis, Hofmann
/// 1999), from rows chosen farthest first. A local optimum. With r ≥ J the weights themselves.
std::vector<float> mixture_weights(const GroundTruth& truth, std::size_t rank = 4, std::size_t iterations = 200);

/// A way to get weights for an asset, with its names in files (key) and tables (label).
struct SkinMethod {
  std::string key, label;
  std::function<std::vector<float>(const io::DatasetItem&, const GroundTruth&)> predict;
  bool oracle = false;   ///< looks at the true weights in a way that no method could
  bool parallel = true;  ///< may run on several assets at once
};

/// The five above: nearest_bone, inverse_distance, strongest_joint, rank4, mixture4.
std::vector<SkinMethod> skin_baselines();

}  // namespace anigen::eval
