#pragma once
#include "anigen/eval/skin/skin_matrix.h"

// Skin metrics of the published systems, on weights of the same vertices and joints. All take the prediction first and
// throw InputError as check_skin_pair().
namespace anigen::eval {

/// Overlap of the sets of joints that influence a vertex.
struct SkinOverlap {
  double precision = 0, recall = 0;
};

/// Anymate (reference anymate-baselines.md, 6.4), meant for its 8192 sampled points and softmax output.
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

}  // namespace anigen::eval
