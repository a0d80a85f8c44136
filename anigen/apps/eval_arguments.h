#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "anigen/eval/pair.h"

namespace anigen {

/// The command line of anigen-eval.
struct EvalArguments {
  std::vector<std::string> predictions, splits, category_splits, lpips_weights;
  std::string dataset, output, skin_ae, skins;
  std::string normalization = "centroid-rms", prediction_up = "format", dataset_up = "format", worst_by, motion;
  std::string transport = "exact";
  std::vector<std::string> groups;
  std::size_t report_images = 4, motion_images = 0;
  bool no_icp = false, point_to_plane = false, force = false, no_report = false;
  bool accept_other_code = false;
  eval::PairSettings settings;
  // Sparse structures.
  std::string ss_flow, ss_dae, train_split;
  std::vector<double> guidance;  ///< scales, 1: none; empty: that of the flow's config
  std::optional<std::int64_t> steps;
  std::size_t limit = 0, views = 4;
};

}  // namespace anigen
