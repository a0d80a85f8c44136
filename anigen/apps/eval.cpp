#include <cstdio>
#include <memory>

#include "anigen/apps/common/command_line.h"
#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/core/version.h"
#include "anigen/eval/report_html.h"
#include "anigen/eval/skin_evaluation.h"
#ifdef ANIGEN_WITH_TORCH
#include "anigen/pipeline/skin_reconstruction.h"
#endif

namespace {

using namespace anigen;

struct EvalOptions {
  std::string predictions, skin_ae, dataset, out;
  std::vector<std::string> splits;
  std::size_t pictured = 3;
  bool no_report = false;
};

/// Weights encoded by a trained skin auto-encoder and decoded again.
eval::SkinMethod reconstruction(const std::string& run, const CommonOptions& common, Json& settings) {
#ifdef ANIGEN_WITH_TORCH
  at::set_num_threads(common.threads > 0 ? common.threads : thread_count());
  const auto model = std::make_shared<pipeline::SkinReconstruction>(run, common.device);
  settings["checkpoint"] = model->checkpoint().string();
  settings["parameters"] = model->parameters();
  settings["features_per_vertex"] = model->features_per_vertex();
  eval::SkinMethod method;
  method.key = "skin_ae";
  method.label = "SkinAE reconstruction";
  method.parallel = false;
  method.predict = [model](const eval::DatasetItem&, const eval::GroundTruth& truth) {
    return model->reconstruct(truth.joints, truth.parents, truth.skin);
  };
  return method;
#else
  static_cast<void>(common);
  static_cast<void>(settings);
  throw NotSupportedError(run, "", "--skin-ae in a build without LibTorch");
#endif
}

void run(const EvalOptions& options, const CommonOptions& common) {
  Json settings = {{"version", kVersion}, {"ground_truth", options.dataset}};
  std::vector<eval::SkinMethod> methods;
  if (!options.skin_ae.empty()) {
    settings["skin_ae"] = options.skin_ae;
    methods.push_back(reconstruction(options.skin_ae, common, settings));
  }
  if (!options.predictions.empty()) {
    if (!std::filesystem::is_directory(options.predictions))
      throw InputError(options.predictions, "", "no such folder");
    settings["predictions"] = options.predictions;
    methods.push_back(eval::predictions_from_folder(options.predictions));
  }
  for (eval::SkinMethod& baseline : eval::skin_baselines()) methods.push_back(std::move(baseline));

  std::vector<eval::DatasetItem> items = eval::list_dataset(options.dataset);
  if (!options.splits.empty()) items = eval::select_split(items, {options.splits.begin(), options.splits.end()});
  settings["splits"] = options.splits;
  settings["assets"] = items.size();
  if (items.empty()) throw InputError(options.dataset, "", "there is not one asset to evaluate");

  const eval::SkinEvaluation evaluation = eval::evaluate_skin(options.dataset, items, methods, settings);
  const std::filesystem::path out = options.out;
  const Json metrics = eval::to_json(evaluation);
  const std::string table = eval::to_markdown(evaluation);
  write_file_atomically(out / "metrics.json", metrics.dump(2) + "\n");
  write_file_atomically(out / "metrics.csv", to_csv(eval::to_csv_table(evaluation)));
  write_file_atomically(out / "table.md", table);
  if (!options.no_report) {
    eval::ReportOptions report;
    report.dataset = options.dataset;
    report.pictured = options.pictured;
    report.title = "Skin weights: " + methods[0].label;
    if (std::filesystem::is_directory(options.skin_ae))
      report.training_metrics = std::filesystem::path(options.skin_ae) / "metrics.csv";
    write_file_atomically(out / "report.html", eval::skin_report(evaluation, report));
  }
  std::fputs(common.json ? (metrics.dump(2) + "\n").c_str() : table.c_str(), stdout);
  const auto scored = eval::summarize(evaluation, 0, eval::Group::kUsable)[0].n +
                      eval::summarize(evaluation, 0, eval::Group::kNotUsable)[0].n;
  if (scored == 0)
    throw Error("no asset could be scored for " + methods[0].label + "; " + (out / "metrics.csv").string() +
                " says why");
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{
      "Compares predicted skin weights with the ground truth of a dataset, beside baselines and oracles.\n"
      "Writes metrics.json, metrics.csv, table.md and report.html.\n\n"
      "Examples:\n"
      "  anigen-eval --skin-ae runs/skin_ae --gt data/mixed --split data/mixed/splits/test.txt --out results\n"
      "  anigen-eval --pred predictions/ --gt data/mixed --out results\n"
      "  anigen-eval --gt data/mixed --out results          (baselines only)"};
  CommonOptions common;
  EvalOptions options;
  app.add_option("--pred", options.predictions, "Folder of <id>.npz with skin [V, J] for the ground truth's vertices");
  app.add_option("--skin-ae", options.skin_ae, "Run folder or checkpoint of a skin auto-encoder to reconstruct with");
  app.add_option("--gt", options.dataset, "Dataset with the ground truth")->required();
  app.add_option("--split", options.splits, "Files of ids to evaluate; without, the whole dataset");
  app.add_option("--out", options.out, "Folder for the results")->required();
  app.add_option("--pictures", options.pictured, "Worst and best assets to draw in the report, each")
      ->capture_default_str();
  app.add_flag("--no-report", options.no_report, "Do not write report.html");
  add_common_options(app, common);
  return run_command(app, common, argc, argv, [&] { run(options, common); });
}
