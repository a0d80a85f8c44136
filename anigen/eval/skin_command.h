#pragma once
#include <cstddef>
#include <filesystem>
#include <vector>

#include "anigen/eval/skin_evaluation.h"

namespace anigen::eval {

/// What `anigen-eval --skin-ae …`, `--skins …` or neither was asked to do.
struct SkinRequest {
  std::filesystem::path dataset, out;
  std::filesystem::path run;  ///< of the skin auto-encoder, whose training curves the report shows; may be empty
  std::vector<std::filesystem::path> splits;
  std::vector<SkinMethod> methods;  ///< before the predictions of `skins` and the baselines, which are added
  std::filesystem::path skins;      ///< folder for predictions_from_folder(); may be empty
  Json settings = Json::object();   ///< recorded in metrics.json
  std::size_t pictured = 3;
  bool report = true;
};

/// Evaluates and writes metrics.json, metrics.csv, table.md and report.html into request.out.
/// @throws InputError when the dataset or a split cannot be read or nothing is left
SkinEvaluation run_skin_evaluation(const SkinRequest& request);

/// @throws Error when not one asset has scores for the first method
void require_scores(const SkinEvaluation& evaluation, const std::filesystem::path& out);

}  // namespace anigen::eval
