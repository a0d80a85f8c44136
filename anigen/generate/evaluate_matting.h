#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/table.h"
#include "anigen/eval/comparison.h"
#include "anigen/generate/preprocess.h"

namespace anigen::generate {

/// Request of `anigen-eval --matting-network …`.
struct MattingEvaluationRequest {
  MattingOptions matting;                     ///< the network: a run of ours or ONNX
  std::string data;                           ///< dataset roots, comma-separated, with condition views
  std::vector<std::filesystem::path> splits;  ///< files of ids; none: all assets
  std::filesystem::path backgrounds;  ///< folder of pictures that every second object stands before; empty: none
  std::filesystem::path out;          ///< folder for the results
  std::size_t most = 0;               ///< assets; 0: all
  std::size_t pictured = 8;           ///< rows of the contact sheet
  std::uint64_t seed = 0;             ///< of views, places and backgrounds
};

/// Distance of a mask to the true alpha of a picture.
struct MattingScore {
  double iou = 0.0;  ///< of what is more object than background
  double mae = 0.0;  ///< mean absolute difference of alpha in [0, 1]
};
ANIGEN_JSON_RECORD(MattingScore, iou, mae)

/// @param mask [N] 0 … 255 @param alpha [N] in [0, 1] @throws InputError when they differ in size
MattingScore matting_score(const std::vector<std::uint8_t>& mask, const std::vector<float>& alpha);

struct MattingEvaluation {
  std::vector<std::string> methods;               ///< the network's name, then "GrabCut" (has_grabcut)
  std::vector<std::string> ids;                   ///< of the assets
  std::vector<std::vector<MattingScore>> scores;  ///< [method][asset]
  std::vector<eval::Interval> iou, mae;           ///< [method] 95 %, by bootstrap over assets
  Json settings = Json::object();

  Table table() const;  ///< means with half of their intervals
};

/// Puts one view of each asset before a background, as the dataset AniGenMattings does but in twice the network's usual
/// size, and compares the masks of the network and, in a build with it, of GrabCut with the true one. Writes
/// metrics.csv (per asset), metrics.json, table.md and samples.png into out. A run of ours that finds no object scores
/// as an empty mask.
/// @throws InputError when network, data or splits are unusable, or an ONNX network gives no mask; Interrupted
MattingEvaluation evaluate_matting(const MattingEvaluationRequest& request);

}  // namespace anigen::generate
