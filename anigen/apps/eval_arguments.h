#pragma once
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "anigen/engine/evaluate.h"
#include "anigen/eval/evaluate_command.h"

namespace anigen {

/// The command line of anigen-eval.
struct EvalArguments {
  engine::EvaluateOptions scores;  ///< of --pred
  eval::EvaluationRequest
      shapes;  ///< of --pred: what the library has no option for, as far as it is not below in words
  std::vector<std::string> splits, lpips_weights, prediction_up;
  std::string image_encoder;
  std::string dataset, output, skin_ae, skins;
  std::vector<std::string> skin_runs;
  std::string dataset_up = "format", transport = "exact";
  std::size_t report_images = 4;
  bool point_to_plane = false, force = false, no_report = false;
  // Sparse structures.
  std::string ss_flow, ss_dae, train_split;
  std::vector<double> guidance;  ///< scales, 1: none; empty: that of the flow's config
  std::optional<int> steps;
  std::size_t limit = 0, views = 4;
  // Matting.
  std::string matting_network, backgrounds;
  std::vector<double> matting_mean, matting_deviation;  ///< [3], or empty: the defaults of ONNX networks
  // Of --oracle, which reads --ss-flow and its options too; what is unset is as in anigen-generate.
  bool oracle = false;
  std::string slat_flow, slat_dae;
  std::optional<double> slat_guidance;  ///< scale, 1: none
  std::optional<int> slat_steps;
  std::optional<float> cluster_bandwidth;
  std::optional<int> cluster_min_votes, texture_size;
  std::string cluster_algorithm;  ///< "published", "paper", or empty: as the run's config says
  std::optional<std::size_t> hidden_views;
};

}  // namespace anigen
