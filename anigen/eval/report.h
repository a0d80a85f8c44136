#pragma once
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "anigen/eval/skin_evaluation.h"

namespace anigen::eval {

struct ReportOptions {
  std::string title = "Skin weights";
  std::filesystem::path dataset;           ///< ground truth for the pictures
  std::filesystem::path training_metrics;  ///< metrics.csv of the run, for its "eval." columns; may be empty
  std::size_t pictured = 3;                ///< so many of the worst and of the best usable assets
  int picture_size = 320;                  ///< pixels, of each of three pictures per asset
};

/// One HTML file that needs no other: settings, tables, and for the worst and best assets of the first method the
/// ground truth, the prediction and the l1 error painted on the mesh; curves of held-out quality during training.
std::string skin_report(const SkinEvaluation& evaluation, const ReportOptions& options);

}  // namespace anigen::eval
