#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "anigen/eval/evaluate_command.h"

namespace anigen {

/// The command line of anigen-eval.
struct EvalArguments {
  eval::EvaluationRequest shapes;  ///< of --pred, as far as it is not below in the words of the command line
  std::vector<std::string> splits, lpips_weights, groups;
  std::string dataset, output, skin_ae, skins;
  std::string normalization = "centroid-rms", prediction_up = "format", dataset_up = "format", transport = "exact";
  std::size_t report_images = 4;
  bool no_icp = false, point_to_plane = false, force = false, no_report = false;
  // Sparse structures.
  std::string ss_flow, ss_dae, train_split;
  std::vector<double> guidance;  ///< scales, 1: none; empty: that of the flow's config
  std::optional<std::int64_t> steps;
  std::size_t limit = 0, views = 4;
  // Of --oracle, which reads --ss-flow and its options too; what is unset is as in anigen-generate.
  bool oracle = false;
  std::string slat_flow, slat_dae;
  std::optional<double> slat_guidance;  ///< scale, 1: none
  std::optional<std::int64_t> slat_steps;
  std::optional<float> cluster_bandwidth;
  std::optional<int> cluster_min_votes, texture_size;
  std::optional<std::size_t> hidden_views;
};

}  // namespace anigen
