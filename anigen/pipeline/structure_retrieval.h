#pragma once
#include <cstddef>
#include <vector>

#include "anigen/pipeline/structure_generator.h"

namespace anigen::pipeline {

/// Descriptions of pictures, in which near means alike: one row each.
struct PictureFeatures {
  torch::Tensor color;   ///< [N, 3 · cells²], picture_cells()
  torch::Tensor tokens;  ///< [N, M · C] the image encoder's tokens, of length 1
};

/// @param pictures [B, 3, S, S]
PictureFeatures picture_features(StructureGenerator& generator, const torch::Tensor& pictures);

/// The training pictures that new ones are compared with.
class StructureRetrieval {
 public:
  /// @param views random condition views of every asset of `training`
  StructureRetrieval(StructureGenerator& generator, const loaders::StructureLatentDataset& training, std::size_t views);

  struct Nearest {
    std::size_t by_color = 0, by_tokens = 0;  ///< training assets
  };
  /// @param features of one picture
  Nearest nearest(const PictureFeatures& features) const;

 private:
  PictureFeatures features_;
  std::size_t views_;
};

}  // namespace anigen::pipeline
