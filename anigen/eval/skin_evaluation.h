#pragma once
#include <array>
#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/table.h"
#include "anigen/eval/skin_baselines.h"
#include "anigen/metrics/skin_metrics.h"

namespace anigen::eval {

/// One method on one asset.
struct MethodResult {
  metrics::SkinScores scores;
  double deformation = 0;  ///< mean of metrics::deformation_error(), the asset's box being 1; with poses alone
  std::string failure;     ///< why there are no scores; empty when there are
};

struct AssetResult {
  io::DatasetItem item;
  std::size_t joints = 0, vertices = 0;
  std::size_t unweighted = 0;         ///< vertices without weights in the ground truth, bound to joint 0
  std::vector<MethodResult> methods;  ///< one per method of the evaluation
  std::string skeleton;               ///< tree_signature()
};

/// Mean, median, population standard deviation and number of the assets that have scores.
struct Summary {
  double mean = 0, median = 0, std = 0;
  std::size_t n = 0;
};
Summary summarize(std::vector<double> values);
/// Under the members' names; null for all but `n` without values.
Json to_json(const Summary& summary);

struct SkinEvaluation {
  std::vector<SkinMethod> methods;  ///< the first one is what the evaluation is about, the others stand beside it
  std::vector<AssetResult> assets;
  Json settings;  ///< what was evaluated how; copied to metrics.json
  int poses = 0;  ///< of the deformation error; 0: not measured
};

/// Runs every method on every item. A method that throws on an asset, or returns weights that cannot be scored, gets
/// a failure there and nothing stops. @param poses of the deformation error, 0: none @throws Interrupted after Ctrl-C
SkinEvaluation evaluate_skin(const std::filesystem::path& dataset, const std::vector<io::DatasetItem>& items,
                             const std::vector<SkinMethod>& methods, const Json& settings = Json::object(),
                             int poses = 0);

/// Reads predictions from the NPZ files below a folder, member `skin` [V, J] for the vertices and joints of the ground
/// truth. match_pairs() finds each asset's file: "<id>.npz", or by any other name of it.
/// @param unused when not null: files that belong to none of the assets
/// @throws InputError when there is no such folder, or as match_pairs() when a name is ambiguous
SkinMethod predictions_from_folder(const std::filesystem::path& folder, const std::filesystem::path& dataset,
                                   const std::vector<io::DatasetItem>& items,
                                   std::vector<std::string>* unused = nullptr);

/// Assets that a summary covers.
enum class Group { kUsable, kNotUsable };

/// The summaries of a method's three scores over the assets of a group.
/// @param influence_class only these vertices: per asset first, then over the assets that have such vertices
std::array<Summary, 3> summarize(const SkinEvaluation& evaluation, std::size_t method, Group group,
                                 std::optional<std::size_t> influence_class = std::nullopt);

/// metrics.json: settings; method, summary, by_influences, not_usable and assets of the first method; and the same
/// for all methods under `methods`.
Json to_json(const SkinEvaluation& evaluation);
/// metrics.csv: one row per asset and method.
CsvTable to_csv_table(const SkinEvaluation& evaluation);
/// table.md: the usable assets, those that are not (named), failures (named with their reason).
std::string to_markdown(const SkinEvaluation& evaluation);

/// Request of `anigen-eval --skin-ae …`, `--skins …` or neither.
struct SkinRequest {
  std::filesystem::path dataset, out;
  std::filesystem::path run;  ///< of the skin auto-encoder, whose training curves the report shows; may be empty
  std::vector<std::filesystem::path> splits;
  std::vector<SkinMethod> methods;  ///< before the predictions of `skins` and the baselines, which are added
  std::filesystem::path skins;      ///< folder for predictions_from_folder(); may be empty
  Json settings = Json::object();   ///< recorded in metrics.json
  std::size_t pictured = 3;
  bool report = true;
  int poses = 0;  ///< of the deformation error, measured beside the weights, with means over skeletons; 0: neither
};

/// Evaluates and writes metrics.json, metrics.csv, table.md and report.html into request.out.
/// @throws InputError when the dataset or a split cannot be read or nothing is left
SkinEvaluation run_skin_evaluation(const SkinRequest& request);

/// @throws Error when not one asset has scores for the first method
void require_scores(const SkinEvaluation& evaluation, const std::filesystem::path& out);

/// Methods × scores over a group of assets: mean l1, l2, KL, median l1, and mean l1 by number of true influences.
anigen::Table summary_table(const SkinEvaluation& evaluation, Group group);

/// The first method's scores per asset of a group, worst l1 first; failures last with their reason.
anigen::Table asset_table(const SkinEvaluation& evaluation, Group group);

/// Assets of a group, whether they have scores or not.
std::size_t count(const SkinEvaluation& evaluation, Group group);

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
