#include "anigen/pipeline/anymate_skin.h"

#include <algorithm>
#include <cstdint>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/interrupt.h"
#include "anigen/models/anymate/skinning.h"

namespace anigen::pipeline {
namespace {

using models::anymate::DecoderKind;
using models::anymate::SkinningImpl;
using models::anymate::SkinningInput;
using torch::Tensor;

constexpr std::int64_t kVerticesAtOnce = 65536;
constexpr double kLeastShare = 1e-4;  // as generation does (decoded_asset.h): a softmax is nowhere zero

void append_rows(const Tensor& shares, const std::vector<int>& heads, SkinWeights& skin) {
  const float* next = shares.data_ptr<float>();
  // With very many bones all shares may be small; of each row the largest stays.
  const auto least = static_cast<float>(std::min(kLeastShare, 0.5 / static_cast<double>(heads.size())));
  for (std::int64_t v = 0; v < shares.size(0); ++v) {
    std::vector<Influence> row;
    for (const int head : heads) {
      const float share = *next++;
      if (share >= least) row.push_back({head, share});
    }
    skin.append_row(std::move(row));
  }
}

/// Logits of the bones at any points of a shape that was encoded once.
class BoneLogits {
 public:
  BoneLogits(models::anymate::AnymateModel model, const Tensor& cloud, const RigBones& bones)
      : model_(std::move(model)), decoder_(model_->decoder<SkinningImpl>()) {
    input_.latents = model_->encode(cloud);
    input_.bones = bones.bones.unsqueeze(0).to(cloud.device());
    if (model_->options().decoder != DecoderKind::kConcatSkinning) return;
    // This head knows whole runs of points of the surface only.
    const std::int64_t run = model_->options().concat_skinning.concat_num;
    input_.points = cloud.slice(1, 0, cloud.size(1) / run * run);
    of_points_ = decoder_.forward(input_)[0].cpu();
  }

  /// @param vertices [V, 6] on the CPU @return [V, K] on the CPU
  Tensor at(const Tensor& vertices) {
    if (of_points_.defined()) {
      const Tensor points = input_.points[0].slice(1, 0, 3).cpu();
      return models::anymate::nearest_point_logits(vertices.slice(1, 0, 3), points, of_points_);
    }
    input_.points = vertices.unsqueeze(0).to(input_.latents.device());
    return decoder_.forward(input_)[0].cpu();
  }

 private:
  models::anymate::AnymateModel model_;
  SkinningImpl& decoder_;
  SkinningInput input_;
  Tensor of_points_;
};

}  // namespace

SkinWeights anymate_skin(const TrainedAnymateModel& skinning, const Tensor& cloud, const Tensor& vertices,
                         const RigBones& bones, std::size_t most_influences) {
  const torch::NoGradGuard no_grad;
  BoneLogits logits(skinning.model, cloud, bones);
  SkinWeights skin;
  for (const Tensor& block : vertices.split(kVerticesAtOnce, 0)) {
    throw_if_interrupted();
    const Tensor shares = torch::softmax(logits.at(block).to(torch::kFloat32), -1).contiguous();
    if (!shares.isfinite().all().item<bool>()) {
      throw InputError(skinning.file.string(), "", "this model gives weights that are not finite");
    }
    append_rows(shares, bones.heads, skin);
  }
  return most_influences == 0 ? skin : limit_influences(skin, most_influences);
}

}  // namespace anigen::pipeline
