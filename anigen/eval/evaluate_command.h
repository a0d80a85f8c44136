#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "anigen/eval/comparison.h"
#include "anigen/eval/pair.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "anigen/metrics/image.h"

namespace anigen::eval {

/// Request of `anigen-eval --pred … --dataset … --output …`.
struct EvaluationRequest {
  std::vector<std::string> predictions;  ///< "PATH" or "NAME=PATH", each a source (open_source) or, ending in .csv,
                                         ///< a list of pairs (read_pairs_csv)
  std::filesystem::path truth;           ///< a source; empty when every prediction is a list of pairs
  std::vector<std::filesystem::path> splits;
  std::size_t most = 0;  ///< only so many of the first assets; 0: all
  /// Lists of the truth's ids whose categories predictions are sorted into, for the metric "category".
  std::vector<std::filesystem::path> category_splits;
  std::filesystem::path out;
  io::Axes prediction_axes = io::Axes::kFormat, truth_axes = io::Axes::kFormat;
  std::map<std::string, io::Axes> axes_of_methods;  ///< by name, where they differ from prediction_axes
  PairSettings settings;
  /// Called from several threads; settings.lpips and settings.image_encoder describe them.
  metrics::PerceptualDistances perceptual;
  bool resume = true, accept_other_code = false;  ///< as ComparisonRun's
  bool report = true;
  std::size_t pictured = 6;
  std::string protocol;              ///< of evaluation_protocol(): fixes the settings; empty: none
  std::string motion;                ///< FILE or FILE#CLIP that every truth moves by (read_motion()); empty: its own
  std::size_t motions_pictured = 0;  ///< assets drawn in motion: into out/motion and the report
  std::string worst_by;

  io::Axes axes_of(const std::string& method) const;
};

/// Words of --pred-up, "z-up" for all predictions and "NAME=z-up" for those called so, into the request.
/// @throws InputError for another word, and for one prediction's axis given twice
void set_prediction_axes(const std::vector<std::string>& words, EvaluationRequest& request);

/// Evaluates and writes metrics.json, metrics.csv, table.md, table.tex and report.html into request.out, and
/// protocol.md where one is asked for; results of
/// single pairs lie under out/pairs, from where an interrupted run goes on. Pictures of motions
/// and the rigs with their clips go to out/motion/<asset>.
/// @return what was written @throws InputError for what is wrong with the request, before any work where a result would
/// replace an input; what is wrong with one asset is that asset's row
Comparison run_evaluation(const EvaluationRequest& request);

/// "NAME=PATH" split; a path alone is called by its last part without extension.
std::pair<std::string, std::filesystem::path> named_path(const std::string& text);

}  // namespace anigen::eval
