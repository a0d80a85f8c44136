#pragma once
#include <torch/types.h>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/data/view_files.h"
#include "anigen/generate/picture_input.h"

namespace anigen::generate {

/// Descriptions of pictures in which near means alike: means of colour over 16 × 16 cells.
/// @param pictures [B, 3, S, S] @return [B, 3 · 256]
inline torch::Tensor picture_cells(const torch::Tensor& pictures) {
  constexpr std::int64_t kCells = 16;
  const torch::NoGradGuard no_grad;
  return torch::adaptive_avg_pool2d(pictures, {kCells, kCells}).flatten(1);
}

struct RetrievalRequest {
  std::filesystem::path dataset;              ///< with renders_cond/
  std::vector<std::filesystem::path> splits;  ///< of what may be answered; none: all
  /// Compared quantity: colours, or the normals that a flow trained on them sees. Those need maps of normals.
  data::ConditionPictures seen = data::ConditionPictures::kColor;
  /// Run folder of stage 4 whose image encoder describes pictures, in place of picture_cells(), by its tokens divided
  /// by their length; `seen` is then what the flow was trained on. Empty: none.
  std::filesystem::path encoder;
  std::string device = "cpu";     ///< of the encoder
  std::size_t views = 0;          ///< condition views looked at per asset; 0: all
  PreprocessingOptions pictures;  ///< of the pictures asked about
  std::filesystem::path output;   ///< <picture's name>/mesh.glb and generation.json, as generation writes
};

struct RetrievalReport {
  std::string name;
  std::filesystem::path file;
  std::string failure;    ///< empty: there is a file
  std::string asset;      ///< the data set's answer
  double distance = 0.0;  ///< root of the mean squared difference of colours in [0, 1], or of descriptions
};

/// The baseline that invents nothing: each picture is answered with the asset of a data set that has the most similar
/// condition view. Both are cropped and put on black as generation does, and compared by the means of colour (or of
/// normals) over 16 × 16 cells, or by the tokens of a trained encoder. A picture that fails, for whatever reason, is
/// reported and does not stop the others. Assets with a damaged view are left out, with a warning.
/// @throws InputError when the data set has no usable condition views, two pictures have one name, or a result would
/// replace an input, before any work; WriteError when the disk refuses
std::vector<RetrievalReport> retrieve_assets(const RetrievalRequest& request,
                                             const std::vector<NamedPicture>& pictures);

Json to_json(const std::vector<RetrievalReport>& reports);
std::string to_text(const std::vector<RetrievalReport>& reports);

}  // namespace anigen::generate
