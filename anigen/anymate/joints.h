#pragma once
#include <vector>

#include "anigen/anymate/blocks.h"
#include "anigen/anymate/heads.h"
#include "anigen/anymate/model.h"
#include "anigen/nn/init.h"
#include "anigen/nn/torch.h"

namespace anigen::anymate {

struct DbscanOptions {
  double eps = 0.03;             ///< reach of a point, inclusive
  std::int64_t min_samples = 1;  ///< points within reach, itself included, that make a point a core point
};

/// Clusters of points (Ester et al. 1996). Core points within reach of each other share a cluster, numbered by the
/// first core point in index order; a point in reach of cores of several clusters joins the first of them; the others
/// are noise. With min_samples 1 nothing is noise, and clusters are the connected components of "distance <= eps".
/// @param points [N, 3] floating, any device; distances in fp64
/// @return [N] labels from 0, -1 for noise @throws InputError for a shape, an option out of range or a point that is
/// not
///   finite
std::vector<std::int64_t> dbscan_labels(const Tensor& points, const DbscanOptions& options);

/// Mean of each cluster in label order, formed in fp64; noise is left out.
/// @param points [N, 3] @return [K, 3], dtype of the points, on the CPU
Tensor cluster_means(const Tensor& points, const std::vector<std::int64_t>& labels);

/// Clusters the joints of a regression or a diffusion into a set: the means of dbscan_labels. The released eps is
/// 0.03 for regression and 0.05 for diffusion (docs/reference/anymate.md, 3.1 and 3.2).
Tensor merged_joints(const Tensor& joints, const DbscanOptions& options = {});

/// Joints straight from the shape ("transformer_latent", docs/reference/anymate.md, 3.1): learned queries attend to the
/// latents once. Keys `query` [Q, W], `cross_attn_decoder.*`, `ln_post.*`, `output_proj.*`.
class JointRegressionImpl : public torch::nn::Module {
 public:
  /// @param num_joints queries, and so joints; merged_joints (dbscan.h) makes one of those that fall together
  explicit JointRegressionImpl(const HeadOptions& options = {}, std::int64_t num_joints = 96,
                               std::int64_t out_channels = 3, nn::Init init = nn::Init::kPublished);
  Tensor forward(const Tensor& latents);  ///< @param latents [B, L, W] @return [B, Q, 3] @throws InputError

 private:
  std::int64_t width_;
  Tensor query_;
  ResidualCrossAttention cross_attn_decoder_ = nullptr;
  nn::AffineLayerNorm ln_post_ = nullptr;
  nn::Linear output_proj_ = nullptr;
};
TORCH_MODULE(JointRegression);

/// Mean over the batch of the distance between two point sets: half the mean distance of each prediction to its nearest
/// joint plus half that of each joint to its nearest prediction, not squared (docs/reference/anymate.md, 6.1).
/// @param predicted [B, Q, 3] @param joints [B, J, 3], padded @param counts of real joints of each item, at least 1
/// @return scalar @throws InputError for shapes or counts that do not fit
Tensor joint_chamfer_loss(const Tensor& predicted, const Tensor& joints, const std::vector<std::int64_t>& counts);

/// Options of predicted_joints beside the model; each kind of decoder looks at its own part.
struct JointPrediction {
  double eps = 0.0;                    ///< joints this near become one; 0: as released, 0.03 regressed, 0.05 denoised
  std::int64_t denoised_joints = 128;  ///< how many a denoiser starts from
  std::int64_t train_steps = 100;      ///< levels of noise that it was trained with
  Tensor noise;                        ///< [1, denoised_joints, 3] standard normal draws; only a denoiser needs them
  Tensor cells;                        ///< [V, 3] integers in [0, 64): where a field is asked about; only it needs them
};

/// The joints of one shape by whichever decoder for joints the model has, merged as at inference
/// (docs/reference/anymate.md, 3). No gradient is recorded.
/// @param latents [1, ...], of AnymateModelImpl::encode @return [J, 3] fp32 on the CPU; a field may have none
/// @throws InputError for a decoder of another task, shapes, and noise or cells that are missing
Tensor predicted_joints(AnymateModelImpl& model, const Tensor& latents, const JointPrediction& options = {});

}  // namespace anigen::anymate
