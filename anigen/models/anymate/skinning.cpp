#include "anigen/models/anymate/skinning.h"

#include <string>
#include <vector>

#include "anigen/fields/tensor_points.h"
#include "anigen/geometry/nearest_vertex.h"
#include "anigen/models/anymate/checks.h"
#include "anigen/models/anymate/embedders.h"

namespace anigen::models::anymate {
namespace {

constexpr double kMaskedBone = -1e8;
constexpr double kStretch = 1.002, kShift = 0.001;  // so that a softmax can reach 0 and 1
constexpr double kSkinLogFloor = 1e-6, kLeastLength = 1e-6;

Tensor mean_cosine(const Tensor& a, const Tensor& b) {
  const Tensor a_length = a.norm(2, -1, true).clamp_min(kLeastLength),
               b_length = b.norm(2, -1, true).clamp_min(kLeastLength);
  return ((a / a_length) * (b / b_length)).sum(-1).mean();
}

}  // namespace

SkinningEmbedding::SkinningEmbedding(torch::nn::Module& head, const HeadOptions& options, bool separate)
    : num_freqs_(options.num_freqs) {
  const std::int64_t position = fourier_width(options.num_freqs), width = options.width;
  bone_proj_ = head.register_module("bone_proj", nn::Linear(2 * position, width));
  if (separate) {
    pc_proj_ = head.register_module("pc_proj", nn::Linear(position + kHarmonics, width));
  } else {
    co_proj_ = head.register_module("co_proj", nn::Linear(position, width));
    normal_proj_ = head.register_module("normal_proj", nn::Linear(kHarmonics, width));
  }
}

Tensor SkinningEmbedding::points(const Tensor& points) {
  const Tensor position = fourier_features(points.slice(-1, 0, 3), num_freqs_, /*include_pi=*/true);
  const Tensor normal = spherical_harmonics(points.slice(-1, 3, 6));
  if (!pc_proj_.is_empty()) return pc_proj_(torch::cat({position, normal}, -1));
  return co_proj_(position) + normal_proj_(normal);
}

Tensor SkinningEmbedding::bones(const Tensor& bones) {
  const Tensor head = fourier_features(bones.slice(-1, 0, 3), num_freqs_, /*include_pi=*/true);
  const Tensor tail = fourier_features(bones.slice(-1, 3, 6), num_freqs_, /*include_pi=*/true);
  return bone_proj_(torch::cat({head, tail}, -1));
}

Tensor checked_bones(const SkinningInput& input, std::int64_t width) {
  require_shape(input.latents, {-1, -1, width}, "latents");
  require_shape(input.points, {input.latents.size(0), -1, 6}, "points");
  require_shape(input.bones, {input.latents.size(0), -1, 6}, "bones");
  if (!input.mask.defined()) return input.bones;
  require_shape(input.mask, {input.bones.size(0), -1}, "bones_mask");
  require(input.mask.size(1) <= input.bones.size(1), "bones_mask", "is for more bones than there are");
  return input.bones.narrow(1, 0, input.mask.size(1));
}

Tensor masked_bone_logits(const Tensor& logits, const Tensor& mask) {
  return mask.defined() ? logits.masked_fill((mask == 0).unsqueeze(1), kMaskedBone) : logits;
}

Tensor training_points(std::int64_t points, std::int64_t count) {
  require(count > 0 && count <= points, "count",
          std::to_string(count) + " of " + std::to_string(points) + " points were asked for");
  return torch::randperm(points, torch::kInt64).slice(0, 0, count);
}

Tensor nearest_point_logits(const Tensor& vertices, const Tensor& points, const Tensor& logits) {
  require_shape(logits, {points.defined() && points.dim() == 2 ? points.size(0) : -1, -1}, "logits");
  const geometry::NearestVertex nearest(fields::points_of(points, "points"));
  const std::vector<std::int32_t> rows = nearest.query(fields::points_of<double>(vertices, "vertices"));
  const Tensor index = torch::tensor(rows, torch::kInt32).to(logits.device(), torch::kInt64);
  return logits.index_select(0, index);
}

SkinningLosses skinning_losses(const Tensor& logits, const Tensor& truth) {
  require_shape(logits, {-1, -1, -1}, "logits");
  require_shape(truth, logits.sizes().vec(), "skins");
  const Tensor weights = torch::softmax(logits, -1);
  SkinningLosses losses;
  losses.cos = 1.0 - mean_cosine(weights, truth);
  losses.cos_clamp = 1.0 - mean_cosine((kStretch * weights - kShift).clamp(0.0, 1.0), truth);
  losses.ce = -(truth * (weights + kSkinLogFloor).log()).sum(-1).mean();
  return losses;
}

}  // namespace anigen::models::anymate
