#include "anigen/eval/skin_command.h"

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/version.h"
#include "anigen/eval/report_html.h"
#include "anigen/io/rigs/split.h"

namespace anigen::eval {

SkinEvaluation run_skin_evaluation(const SkinRequest& request) {
  std::vector<io::DatasetItem> items = io::list_dataset(request.dataset);
  if (!request.splits.empty()) items = select_split(items, request.splits);
  if (items.empty()) throw InputError(request.dataset.string(), "", "there is not one asset to evaluate");
  refuse_to_overwrite({request.out / "metrics.json", request.out / "metrics.csv", request.out / "table.md",
                       request.out / "report.html"},
                      [&] {
                        std::vector<std::filesystem::path> inputs = request.splits;
                        inputs.push_back(request.dataset / "metadata.csv");
                        if (std::filesystem::is_directory(request.run)) inputs.push_back(request.run / "metrics.csv");
                        return inputs;
                      });
  Json settings = request.settings;
  std::vector<SkinMethod> methods = request.methods;
  if (!request.skins.empty()) {
    std::vector<std::string> unused;
    methods.push_back(predictions_from_folder(request.skins, request.dataset, items, &unused));
    settings["skins"] = request.skins.string();
    settings["unused_predictions"] = unused;
    if (!unused.empty())
      log::warn("{}: {} files belong to none of the assets ({})", request.skins.string(), unused.size(),
                io::listed({unused.begin(), unused.end()}));
  }
  for (SkinMethod& baseline : skin_baselines()) methods.push_back(std::move(baseline));
  settings["version"] = kVersion;
  settings["commit"] = commit();
  settings["ground_truth"] = request.dataset.string();
  Json splits = Json::array();
  for (const auto& split : request.splits) splits.push_back(split.string());
  settings["splits"] = splits;
  settings["assets"] = items.size();

  SkinEvaluation evaluation = evaluate_skin(request.dataset, items, methods, settings);
  write_file_atomically(request.out / "metrics.json", to_json(evaluation).dump(2) + "\n");
  write_file_atomically(request.out / "metrics.csv", to_csv(to_csv_table(evaluation)));
  write_file_atomically(request.out / "table.md", to_markdown(evaluation));
  if (request.report) {
    ReportOptions report;
    report.dataset = request.dataset;
    report.pictured = request.pictured;
    report.title = "Skin weights: " + methods[0].label;
    if (std::filesystem::is_directory(request.run)) report.training_metrics = request.run / "metrics.csv";
    write_file_atomically(request.out / "report.html", skin_report(evaluation, report));
  }
  return evaluation;
}

void require_scores(const SkinEvaluation& evaluation, const std::filesystem::path& out) {
  if (summarize(evaluation, 0, Group::kUsable)[0].n + summarize(evaluation, 0, Group::kNotUsable)[0].n > 0) return;
  throw Error("no asset could be scored for " + evaluation.methods[0].label + "; " + (out / "metrics.csv").string() +
              " says why");
}

}  // namespace anigen::eval
