#include "anigen/pipeline/structure_retrieval.h"

#include "anigen/core/interrupt.h"
#include "anigen/core/progress.h"
#include "anigen/pipeline/picture_cells.h"

namespace anigen::pipeline {

using torch::Tensor;

PictureFeatures picture_features(StructureGenerator& generator, const Tensor& pictures) {
  const torch::NoGradGuard no_grad;
  const Tensor tokens = generator.condition(pictures).to(torch::kCPU).flatten(1);
  return {picture_cells(pictures), tokens / tokens.norm(2, {1}, /*keepdim=*/true).clamp_min(1e-12)};
}

StructureRetrieval::StructureRetrieval(StructureGenerator& generator, const loaders::StructureLatentDataset& training,
                                       std::size_t views)
    : views_(views) {
  std::vector<Tensor> color, tokens;
  Progress progress("describing training pictures", training.assets(), "assets");
  for (std::size_t asset = 0; asset < training.assets(); ++asset) {
    throw_if_interrupted();
    std::vector<loaders::Draw> draws;
    for (std::size_t view = 0; view < views; ++view) {
      draws.push_back({training.item_of(asset), asset * views + view});  // the position chooses the view
    }
    const auto batch = training.load(draws);
    const PictureFeatures one =
        picture_features(generator, dynamic_cast<const loaders::StructureLatentBatch&>(*batch).cond);
    color.push_back(one.color);
    tokens.push_back(one.tokens);
    progress.advance();
  }
  progress.finish();
  features_ = {torch::cat(color), torch::cat(tokens)};
}

StructureRetrieval::Nearest StructureRetrieval::nearest(const PictureFeatures& features) const {
  const auto row = [&](const Tensor& distances) {
    return static_cast<std::size_t>(distances.argmin().item<std::int64_t>()) / views_;
  };
  return {row((features_.color - features.color).square().sum(1)), row(-features_.tokens.mv(features.tokens[0]))};
}

}  // namespace anigen::pipeline
