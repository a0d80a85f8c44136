#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <string>
#include <vector>

#include "anigen/asset/skin_weights.h"

// Skin metrics of the published systems, on weights of the same vertices and joints. All take the prediction first and
// throw InputError as check_skin_pair().

namespace anigen::metrics {

/// Dense skin weights, one row per vertex, one column per joint. Row-major, so that a std::vector<double> [V, J] can be
/// passed without a copy (see skin_matrix()).
using SkinMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using SkinMatrixView = Eigen::Ref<const SkinMatrix>;

/// @throws InputError when there are not rows · joints values
Eigen::Map<const SkinMatrix> skin_matrix(const std::vector<double>& dense, std::size_t vertices, std::size_t joints);
SkinMatrix skin_matrix(const std::vector<float>& dense, std::size_t vertices, std::size_t joints);

/// Predicted weights expressed in the true joints by a transport plan π between the joint measures
/// (docs/reference/training.md, 7.4): W̃ = W · diag(1/a) · π, where a are the plan's row sums (1/n each for uniform
/// measures, so W̃ = n W π). Soft: a joint split between two true ones hands on its weight in that proportion. Rows sum
/// to 1.
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

/// Added to both weights inside the logarithm of the divergence (docs/reference/training.md, 7.4).
inline constexpr double kKlEpsilon = 1e-8;

/// Vertices are also scored by how many joints truly move them: 1, 2, 3, 4, and 5 or more.
inline constexpr std::size_t kInfluenceClasses = 5;

/// Distances between predicted and true skin weights, W and Ŵ, each averaged over vertices:
///   l1 = Σ_j |Ŵ_vj − W_vj|            a sum over joints, so between 0 and 2
///   l2 = (Σ_j (Ŵ_vj − W_vj)²)^½       a norm over joints, so between 0 and √2
///   kl = Σ_j W_vj log((W_vj + ε) / (Ŵ_vj + ε)), natural logarithm, ground truth first
struct SkinScore {
  double l1 = 0, l2 = 0, kl = 0;
};

struct SkinScores {
  SkinScore mean;                                            ///< over all vertices
  std::array<SkinScore, kInfluenceClasses> by_influences;    ///< over the vertices of one class
  std::array<std::size_t, kInfluenceClasses> class_sizes{};  ///< vertices in each class
};

/// @param predicted, truth row-major [V, J], finite, not negative, rows summing to 1
/// @return all zeros when there are no vertices
SkinScores score_skin(const std::vector<float>& predicted, const std::vector<float>& truth, std::size_t vertices,
                      std::size_t joints);

/// The l1 of every vertex, [V], for pictures.
std::vector<float> vertex_l1(const std::vector<float>& predicted, const std::vector<float>& truth, std::size_t vertices,
                             std::size_t joints);

/// Makes weights from a file fit for scoring: rows are divided by their sum.
/// @return how many rows were off by more than 1e-3
/// @throws InputError naming row and joint for a negative or not finite weight, or a row without any
std::size_t normalize_rows(std::vector<float>& dense, std::size_t rows, std::size_t joints, const std::string& file);

/// Overlap of the sets of joints that influence a vertex.
struct SkinOverlap {
  double precision = 0, recall = 0;
};

/// Anymate (docs/reference/anymate.md, 6.4), meant for its 8192 sampled points and softmax output.
struct AnymateSkinScore {
  double cos_loss = 0;        ///< 1 − mean over vertices of the cosine; the paper's Cos is 1 minus this
  double cross_entropy = 0;   ///< mean over vertices of −Σ_k w ln(ŵ + 1e-6)
  double cos_clamp_loss = 0;  ///< cos_loss of ŵ · 1.002 − 0.001 clamped to [0, 1]
  double mae = 0;             ///< mean of |ŵ − w| over all entries: shrinks as joints are added
  double mean_l1 = 0;         ///< mean over vertices of Σ_k |ŵ − w|
  SkinOverlap overlap;        ///< mean over vertices; a vertex where either set is empty adds 0 to both
};
inline constexpr double kAnymateSkinThreshold = 0.05;

/// @param threshold a joint influences a vertex from this weight on (≥)
AnymateSkinScore anymate_skin(const SkinMatrixView& predicted, const SkinMatrixView& truth,
                              double threshold = kAnymateSkinThreshold);

/// Puppeteer (10.3).
struct PuppeteerSkinScore {
  SkinOverlap overlap;   ///< over all pairs of vertex and joint of the mesh with weight > 0, not per vertex
  double l1 = 0;         ///< mean over kept vertices of Σ_j |ŵ − w|
  std::size_t kept = 0;  ///< vertices whose true weights sum to 1 within 0.01; the others are left out
};
/// Fraction of a row's largest weight below which weights go; 0.35 is used for ModelsResource.
inline constexpr double kPuppeteerFilter = 0.15;

/// Weights below 1e-3 become 0, then those below filter · (row maximum), then rows are divided by their sum + 1e-10.
SkinMatrix puppeteer_filtered(const SkinMatrixView& predicted, double filter = kPuppeteerFilter);
/// @param predicted as the network gave it: it is filtered here
PuppeteerSkinScore puppeteer_skin(const SkinMatrixView& predicted, const SkinMatrixView& truth,
                                  double filter = kPuppeteerFilter);

/// RigNet (9.3): joints with weight > 1e-4 influence a vertex; overlap averaged over vertices, where an empty predicted
/// set has precision 0 and an empty true one recall 0.
inline constexpr double kRignetSkinThreshold = 1e-4;
SkinOverlap rignet_skin_overlap(const SkinMatrixView& predicted, const SkinMatrixView& truth,
                                double threshold = kRignetSkinThreshold);

/// Plain distances under the names of their averaging; d = ŵ − w.
struct PlainSkinScore {
  double l1_mean = 0;        ///< mean |d| over entries (UniRig's skin_l1)
  double l2_mean = 0;        ///< mean d² over entries (UniRig's skin_l2)
  double l1_per_vertex = 0;  ///< mean over vertices of Σ |d| (RigNet, Puppeteer, `skin_l1` of this project)
  double max_abs = 0;
  /// Mean over vertices of Σ_j t ln(t / max(ŵ, 1e-8)), t the true row divided by its sum (the published trainer of
  /// structured latents); a true row without weight adds 0.
  double kl_batch_mean = 0;
  double kl_element_mean = 0;  ///< mean over entries of w ln(w / (ŵ + 1e-10)) (the published SkinAE trainer)
};
PlainSkinScore plain_skin(const SkinMatrixView& predicted, const SkinMatrixView& truth);

}  // namespace anigen::metrics
