#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/eval/pair.h"

namespace anigen {

/// The command line of anigen-eval.
struct EvalArguments {
  std::vector<std::string> predictions, splits, category_splits, lpips_weights;
  std::string truth, out, skin_ae, skins;
  std::string normalization = "centroid-rms", prediction_axes = "format", truth_axes = "format", worst_by, motion;
  std::string transport = "exact";
  std::vector<std::string> groups;
  std::size_t pictured = 4, motions_pictured = 0;
  int workers = 0;
  bool no_icp = false, point_to_plane = false, no_resume = false, no_report = false;
  bool accept_other_code = false;
  eval::PairSettings settings;
  // Sparse structures.
  std::string ss_flow, ss_dae, train_split;
  std::vector<double> strengths;
  std::int64_t steps = 0;
  std::size_t most = 0, views = 4;
};

}  // namespace anigen
