#include "anigen/eval/skin_evaluation.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iterator>
#include <limits>
#include <map>
#include <utility>

#include "anigen/core/chart.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/process.h"
#include "anigen/core/run_folder.h"
#include "anigen/core/table.h"
#include "anigen/core/text.h"
#include "anigen/core/version.h"
#include "anigen/eval/pairs.h"
#include "anigen/eval/skin_intervals.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/metrics/deformation.h"
#include "anigen/render/contact_sheet.h"
#include "anigen/render/picture.h"

namespace anigen::eval {

namespace {

namespace fs = std::filesystem;

/// The true mesh posed with true and with predicted weights on the same joints.
double deformation_of(const GroundTruth& truth, const std::vector<float>& predicted, int poses) {
  const std::size_t vertices = truth.vertex_count(), joints = truth.joint_count();
  const JointTree tree{in_double(truth.joints), truth.parents};
  metrics::DeformationOptions options;
  options.poses = poses;
  const auto size = static_cast<Eigen::Index>(joints);
  const Eigen::MatrixXd own = Eigen::MatrixXd::Identity(size, size) / static_cast<double>(joints);
  return metrics::deformation_error(in_double(truth.vertices), tree, from_dense(truth.skin, vertices, joints), tree,
                                    from_dense(predicted, vertices, joints), own, options)
      .mean;
}

MethodResult run_method(const SkinMethod& method, const io::DatasetItem& item, const GroundTruth& truth, int poses) {
  MethodResult result;
  try {
    std::vector<float> predicted = method.predict(item, truth);
    if (predicted.size() != truth.skin.size()) {
      throw Error("has " + std::to_string(predicted.size()) + " weights, expected " +
                  std::to_string(truth.skin.size()));
    }
    metrics::normalize_rows(predicted, truth.vertex_count(), truth.joint_count(), method.label);
    result.scores = metrics::score_skin(predicted, truth.skin, truth.vertex_count(), truth.joint_count());
    if (poses > 0) result.deformation = deformation_of(truth, predicted, poses);
  } catch (...) {
    result.failure = failure_of_item();
  }
  return result;
}

/// Vertices that the ground truth does not bind count like all others, for joint 0: whoever reads the scores must know.
void tell_of_unweighted(const std::vector<AssetResult>& assets) {
  std::size_t vertices = 0, touched = 0;
  for (const AssetResult& asset : assets) {
    vertices += asset.unweighted;
    touched += asset.unweighted > 0 ? 1 : 0;
  }
  if (vertices == 0) return;
  log::warn("{} vertices of {} assets have no weight in the ground truth: they are evaluated as bound to joint 0",
            vertices, touched);
}

/// The methods that may (or may not) run in parallel on one asset.
void run_methods(const fs::path& dataset, const std::vector<SkinMethod>& methods, bool parallel, int poses,
                 AssetResult& asset) {
  try {
    const GroundTruth truth = read_ground_truth(dataset, asset.item.id);
    asset.joints = truth.joint_count();
    asset.vertices = truth.vertex_count();
    asset.unweighted = truth.unweighted;
    asset.skeleton = tree_signature(truth.parents);
    for (std::size_t m = 0; m < methods.size(); ++m) {
      if (methods[m].parallel == parallel) asset.methods[m] = run_method(methods[m], asset.item, truth, poses);
    }
  } catch (...) {
    const std::string failure = failure_of_item();
    for (std::size_t m = 0; m < methods.size(); ++m) {
      if (methods[m].parallel == parallel) asset.methods[m].failure = failure;
    }
  }
}

constexpr std::array<const char*, metrics::kInfluenceClasses> kClassNames = {"1", "2", "3", "4", "5+"};

constexpr std::array<const char*, 3> kScoreNames = {"skin_l1", "skin_l2", "skin_kl"};  // as score_values()

Json to_json(const std::array<Summary, 3>& summaries) {
  Json json = Json::object();
  for (std::size_t k = 0; k < 3; ++k) json[kScoreNames[k]] = to_json(summaries[k]);
  return json;
}

Json by_influences(const SkinEvaluation& evaluation, std::size_t method) {
  Json json = Json::object();
  for (std::size_t c = 0; c < metrics::kInfluenceClasses; ++c)
    json[kClassNames[c]] = to_json(summarize(evaluation, method, Group::kUsable, c));
  return json;
}

std::array<double, 3> score_values(const metrics::SkinScore& score) { return {score.l1, score.l2, score.kl}; }

void put_scores(Json& json, const metrics::SkinScore& score) {
  const auto values = score_values(score);
  for (std::size_t k = 0; k < 3; ++k) json[kScoreNames[k]] = values[k];
}

Json asset_json(const AssetResult& asset, std::size_t method, bool with_poses) {
  const MethodResult& result = asset.methods[method];
  Json json = {{"id", asset.item.id},         {"name", asset.item.name},         {"source", asset.item.source},
               {"usable", asset.item.usable}, {"bad_skin", asset.item.bad_skin}, {"joints", asset.joints},
               {"vertices", asset.vertices}};
  if (asset.unweighted > 0) json["unweighted_vertices"] = asset.unweighted;
  if (!result.failure.empty()) {
    json["failure"] = result.failure;
    return json;
  }
  put_scores(json, result.scores.mean);
  if (with_poses) json["deformation"] = result.deformation;
  for (std::size_t c = 0; c < metrics::kInfluenceClasses; ++c) {
    if (result.scores.class_sizes[c] == 0) continue;
    Json group = {{"vertices", result.scores.class_sizes[c]}};
    put_scores(group, result.scores.by_influences[c]);
    json["by_influences"][kClassNames[c]] = group;
  }
  return json;
}

Json method_json(const SkinEvaluation& evaluation, std::size_t method) {
  Json assets = Json::array();
  for (const AssetResult& asset : evaluation.assets) assets.push_back(asset_json(asset, method, evaluation.poses > 0));
  return {{"summary", to_json(summarize(evaluation, method, Group::kUsable))},
          {"by_influences", by_influences(evaluation, method)},
          {"not_usable", to_json(summarize(evaluation, method, Group::kNotUsable))},
          {"assets", assets}};
}

std::string mean_or_dash(const Summary& summary) {
  return anigen::fixed(summary.n > 0 ? summary.mean : std::numeric_limits<double>::quiet_NaN());
}

}  // namespace

Summary summarize(std::vector<double> values) {
  Summary summary;
  summary.n = values.size();
  if (values.empty()) return summary;
  std::sort(values.begin(), values.end());
  const auto n = static_cast<double>(values.size());
  for (const double value : values) summary.mean += value / n;
  for (const double value : values) summary.std += (value - summary.mean) * (value - summary.mean) / n;
  summary.std = std::sqrt(summary.std);
  const std::size_t middle = values.size() / 2;
  summary.median = values.size() % 2 == 1 ? values[middle] : 0.5 * (values[middle - 1] + values[middle]);
  return summary;
}

Json to_json(const Summary& summary) {
  // No value is not a value of zero.
  if (summary.n == 0) return {{"mean", nullptr}, {"median", nullptr}, {"std", nullptr}, {"n", 0}};
  return {{"mean", summary.mean}, {"median", summary.median}, {"std", summary.std}, {"n", summary.n}};
}

SkinEvaluation evaluate_skin(const fs::path& dataset, const std::vector<io::DatasetItem>& items,
                             const std::vector<SkinMethod>& methods, const Json& settings, int poses) {
  SkinEvaluation evaluation{methods, {}, settings, poses};
  evaluation.assets.resize(items.size());
  for (std::size_t i = 0; i < items.size(); ++i) {
    evaluation.assets[i].item = items[i];
    evaluation.assets[i].methods.resize(methods.size());
  }
  const bool serial = std::any_of(methods.begin(), methods.end(), [](const SkinMethod& m) { return !m.parallel; });
  Progress progress("evaluate", items.size() * (serial ? 2 : 1), "assets");
  parallel_for(items.size(), [&](std::size_t i) {
    if (interrupt_requested()) return;
    run_methods(dataset, methods, true, poses, evaluation.assets[i]);
    progress.advance();
  });
  for (std::size_t i = 0; serial && i < items.size(); ++i) {
    throw_if_interrupted();
    run_methods(dataset, methods, false, poses, evaluation.assets[i]);
    progress.advance();
  }
  throw_if_interrupted();
  tell_of_unweighted(evaluation.assets);
  return evaluation;
}

SkinMethod predictions_from_folder(const fs::path& folder, const fs::path& dataset,
                                   const std::vector<io::DatasetItem>& items, std::vector<std::string>* unused) {
  if (!fs::is_directory(folder)) throw InputError(folder.string(), "", "no such folder");
  const std::vector<fs::path> files = io::files_below(folder, {".npz"});
  std::map<std::string, fs::path> by_id;
  std::vector<io::FileListSource::Entry> entries = io::entries_below(folder, files);
  for (const io::FileListSource::Entry& entry : entries) by_id[entry.id] = entry.file;
  // Only names are asked for: weights alone are no shape that could be read.
  const io::FileListSource predictions(std::move(entries), nullptr,
                                       std::to_string(files.size()) + " NPZ files in " + folder.string(), false);
  std::vector<std::string> ids;
  for (const io::DatasetItem& item : items) ids.push_back(item.id);
  PairList list = match_pairs(io::DatasetSource(dataset), predictions, ids);
  std::map<std::string, PairPlan> plans;
  for (PairPlan& plan : list.pairs) plans[plan.id] = std::move(plan);
  if (unused != nullptr) *unused = std::move(list.unused);
  SkinMethod method;
  method.key = "prediction";
  method.label = "prediction";
  method.predict = [by_id, plans](const io::DatasetItem& item, const GroundTruth& truth) {
    const PairPlan& plan = plans.at(item.id);
    if (!plan.prediction_id) throw InputError("", "", plan.missing_reason);
    const fs::path& file = by_id.at(*plan.prediction_id);
    const io::NamedArrays arrays = io::read_npz(file, {"skin"});
    const io::NdArray& skin = *io::find(arrays, "skin");
    const std::vector<std::int64_t> wanted = {static_cast<std::int64_t>(truth.vertex_count()),
                                              static_cast<std::int64_t>(truth.joint_count())};
    if (skin.shape != wanted) {
      throw InputError(file.string(), "skin",
                       "expected shape [" + std::to_string(wanted[0]) + ", " + std::to_string(wanted[1]) +
                           "], one row per vertex and one column per joint of the ground truth");
    }
    return skin.as<float>();
  };
  return method;
}

std::array<Summary, 3> summarize(const SkinEvaluation& evaluation, std::size_t method, Group group,
                                 std::optional<std::size_t> influence_class) {
  std::array<std::vector<double>, 3> values;
  for (const AssetResult& asset : evaluation.assets) {
    const MethodResult& result = asset.methods[method];
    if (!result.failure.empty() || asset.item.usable != (group == Group::kUsable)) continue;
    if (influence_class && result.scores.class_sizes[*influence_class] == 0) continue;
    const auto scores =
        score_values(influence_class ? result.scores.by_influences[*influence_class] : result.scores.mean);
    for (std::size_t k = 0; k < 3; ++k) values[k].push_back(scores[k]);
  }
  return {summarize(values[0]), summarize(values[1]), summarize(values[2])};
}

SkinEvaluation run_skin_evaluation(const SkinRequest& request) {
  std::vector<io::DatasetItem> items = io::list_dataset(request.dataset);
  if (!request.splits.empty()) items = select_split(items, request.splits);
  if (items.empty()) throw InputError(request.dataset.string(), "", "there is not one asset to evaluate");
  refuse_to_overwrite({request.out / "metrics.json", request.out / "metrics.csv", request.out / "table.md",
                       request.out / "report.html"},
                      [&] {
                        std::vector<std::filesystem::path> inputs = request.splits;
                        inputs.push_back(request.dataset / "metadata.csv");
                        if (std::filesystem::is_directory(request.run))
                          inputs.push_back(RunFolder{request.run}.metrics());
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
                listed({unused.begin(), unused.end()}));
  }
  for (SkinMethod& baseline : skin_baselines()) methods.push_back(std::move(baseline));
  settings["made_by"] = made_by();
  settings["ground_truth"] = request.dataset.string();
  settings["splits"] = request.splits;
  settings["assets"] = items.size();
  if (request.poses > 0) settings["poses"] = request.poses;

  SkinEvaluation evaluation = evaluate_skin(request.dataset, items, methods, settings, request.poses);
  write_file_atomically(request.out / "metrics.json", to_json(evaluation).dump(2) + "\n");
  write_file_atomically(request.out / "metrics.csv", to_csv(to_csv_table(evaluation)));
  write_file_atomically(request.out / "table.md", to_markdown(evaluation));
  if (request.report) {
    ReportOptions report;
    report.dataset = request.dataset;
    report.pictured = request.pictured;
    report.title = "Skin weights: " + methods[0].label;
    if (std::filesystem::is_directory(request.run)) report.training_metrics = RunFolder{request.run}.metrics();
    write_file_atomically(request.out / "report.html", skin_report(evaluation, report));
  }
  return evaluation;
}

void require_scores(const SkinEvaluation& evaluation, const std::filesystem::path& out) {
  if (summarize(evaluation, 0, Group::kUsable)[0].n + summarize(evaluation, 0, Group::kNotUsable)[0].n > 0) return;
  throw Error("no asset could be scored for " + evaluation.methods[0].label + "; " + (out / "metrics.csv").string() +
              " says why");
}

Json to_json(const SkinEvaluation& evaluation) {
  Json json = {{"settings", evaluation.settings}};
  json["settings"]["kl_epsilon"] = metrics::kKlEpsilon;
  json["settings"]["definition"] =
      "per vertex: l1 sums |difference| over joints, l2 is the norm over joints, kl is KL(truth || prediction) in "
      "nats; mean over vertices, then over assets; std is the population's";
  if (evaluation.methods.empty()) return json;
  json["method"] = evaluation.methods[0].key;
  json.update(method_json(evaluation, 0));
  json["methods"] = Json::object();
  for (std::size_t m = 0; m < evaluation.methods.size(); ++m) {
    Json one = {{"label", evaluation.methods[m].label}, {"oracle", evaluation.methods[m].oracle}};
    one.update(method_json(evaluation, m));
    if (evaluation.poses > 0) one["over_skeletons"] = to_json(over_skeletons(evaluation, m));
    json["methods"][evaluation.methods[m].key] = one;
  }
  return json;
}

CsvTable to_csv_table(const SkinEvaluation& evaluation) {
  CsvTable table;
  table.columns = {"id", "name", "source", "usable", "method", "joints", "vertices", "skin_l1", "skin_l2", "skin_kl"};
  for (const char* name : kClassNames) table.columns.push_back(std::string("skin_l1_influences_") + name);
  if (evaluation.poses > 0) table.columns.insert(table.columns.end(), {"deformation", "skeleton"});
  table.columns.push_back("failure");
  const auto number = [](double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.9g", value);
    return std::string(text);
  };
  for (const AssetResult& asset : evaluation.assets) {
    for (std::size_t m = 0; m < evaluation.methods.size(); ++m) {
      const MethodResult& result = asset.methods[m];
      std::vector<std::string> row = {asset.item.id,
                                      asset.item.name,
                                      asset.item.source,
                                      asset.item.usable ? "True" : "False",
                                      evaluation.methods[m].key,
                                      std::to_string(asset.joints),
                                      std::to_string(asset.vertices)};
      const bool failed = !result.failure.empty();
      for (const double value : score_values(result.scores.mean)) row.push_back(failed ? "" : number(value));
      for (std::size_t c = 0; c < metrics::kInfluenceClasses; ++c) {
        const bool absent = failed || result.scores.class_sizes[c] == 0;
        row.push_back(absent ? "" : number(result.scores.by_influences[c].l1));
      }
      if (evaluation.poses > 0) {
        row.push_back(failed ? "" : number(result.deformation));
        row.push_back(asset.skeleton);
      }
      row.push_back(result.failure);
      table.rows.push_back(std::move(row));
    }
  }
  return table;
}

anigen::Table summary_table(const SkinEvaluation& evaluation, Group group) {
  anigen::Table table{{"method", "l1", "l2", "KL", "median l1"}, {}};
  for (const char* name : kClassNames) table.columns.push_back("l1, " + std::string(name) + " infl.");
  table.columns.push_back("assets");
  for (std::size_t m = 0; m < evaluation.methods.size(); ++m) {
    const auto scores = summarize(evaluation, m, group);
    std::vector<std::string> row = {evaluation.methods[m].label};
    for (const Summary& score : scores) row.push_back(mean_or_dash(score));
    row.push_back(scores[0].n > 0 ? anigen::fixed(scores[0].median) : "–");
    for (std::size_t c = 0; c < metrics::kInfluenceClasses; ++c)
      row.push_back(mean_or_dash(summarize(evaluation, m, group, c)[0]));
    row.push_back(std::to_string(scores[0].n));
    table.rows.push_back(std::move(row));
  }
  return table;
}

anigen::Table asset_table(const SkinEvaluation& evaluation, Group group) {
  std::vector<const AssetResult*> order;
  for (const AssetResult& asset : evaluation.assets) {
    if (asset.item.usable == (group == Group::kUsable)) order.push_back(&asset);
  }
  std::stable_sort(order.begin(), order.end(), [](const AssetResult* a, const AssetResult* b) {
    const bool a_failed = !a->methods[0].failure.empty(), b_failed = !b->methods[0].failure.empty();
    if (a_failed != b_failed) return b_failed;
    return a->methods[0].scores.mean.l1 > b->methods[0].scores.mean.l1;
  });
  anigen::Table table{{"asset", "joints", "vertices", "l1", "l2", "KL", "note"}, {}};
  for (const AssetResult* asset : order) {
    const MethodResult& result = asset->methods[0];
    std::vector<std::string> row = {asset->item.name, std::to_string(asset->joints), std::to_string(asset->vertices)};
    for (const double value : score_values(result.scores.mean))
      row.push_back(result.failure.empty() ? anigen::fixed(value) : "–");
    row.push_back(!result.failure.empty() ? result.failure : asset->item.bad_skin ? "bad skin" : "");
    table.rows.push_back(std::move(row));
  }
  return table;
}

std::size_t count(const SkinEvaluation& evaluation, Group group) {
  return static_cast<std::size_t>(
      std::count_if(evaluation.assets.begin(), evaluation.assets.end(),
                    [&](const AssetResult& asset) { return asset.item.usable == (group == Group::kUsable); }));
}

std::string to_markdown(const SkinEvaluation& evaluation) {
  if (evaluation.methods.empty()) return "";
  std::string text = "Skin weights on " + std::to_string(count(evaluation, Group::kUsable)) + " usable assets\n\n" +
                     to_markdown(summary_table(evaluation, Group::kUsable));
  if (count(evaluation, Group::kNotUsable) > 0) {
    text += "\nNot usable (too few or too many joints, or equal bones), scored apart\n\n" +
            to_markdown(summary_table(evaluation, Group::kNotUsable)) + "\n" +
            to_markdown(asset_table(evaluation, Group::kNotUsable));
  }
  if (evaluation.poses > 0) {
    text +=
        "\nMeans over skeletons of means over their rigs, usable or not, with half of their 95 % intervals over "
        "skeletons\n\n" +
        to_markdown(skeleton_table(evaluation));
  }
  anigen::Table failures{{"asset", "method", "reason"}, {}};
  for (const AssetResult& asset : evaluation.assets) {
    for (std::size_t m = 0; m < evaluation.methods.size(); ++m) {
      if (asset.methods[m].failure.empty()) continue;
      failures.rows.push_back({asset.item.name, evaluation.methods[m].label, asset.methods[m].failure});
    }
  }
  if (!failures.rows.empty()) text += "\nWithout scores\n\n" + to_markdown(failures);
  return text;
}

namespace {

constexpr const char kStyle[] =
    "body{font:15px/1.45 sans-serif;max-width:1080px;margin:2em auto;padding:0 1em;color:#222}"
    "table{border-collapse:collapse;margin:.6em 0;font-variant-numeric:tabular-nums}"
    "th,td{padding:.2em .7em;border-bottom:1px solid #ddd;text-align:right}"
    "th:first-child,td:first-child{text-align:left}img{max-width:100%}figure{margin:1em 0}code{background:#f3f3f3}";

/// l1 / 2 in [0, 1] as the weight of a made-up joint 0, which the heat map then shows.
SkinWeights error_as_weights(const std::vector<float>& l1) {
  SkinWeights weights;
  for (const float value : l1) {
    const float part = std::clamp(0.5f * value, 0.0f, 1.0f);
    weights.append_row({{0, part}, {1, 1.0f - part}});
  }
  return weights;
}

io::Image compare(const GroundTruth& truth, std::vector<float> predicted, const SkinMethod& method, int size) {
  metrics::normalize_rows(predicted, truth.vertex_count(), truth.joint_count(), method.label);
  const Asset asset = to_asset(truth, truth.skin);
  render::PictureOptions picture;
  picture.width = picture.height = size;
  picture.mode = render::PictureMode::kWeights;
  const render::Tile left{render::render(asset, picture), "ground truth"};
  picture.weights = from_dense(predicted, truth.vertex_count(), truth.joint_count());
  const render::Tile middle{render::render(asset, picture), method.label};
  picture.weights =
      error_as_weights(metrics::vertex_l1(predicted, truth.skin, truth.vertex_count(), truth.joint_count()));
  picture.heat_joints = {0};
  const render::Tile right{render::render(asset, picture), "l1 error, blue 0 to red 2"};
  render::SheetOptions sheet;
  sheet.columns = 3;
  return render::contact_sheet({left, middle, right}, sheet);
}

std::string figure(const SkinEvaluation& evaluation, const AssetResult& result, const ReportOptions& options) {
  const metrics::SkinScore& score = result.methods[0].scores.mean;
  std::string text = "<figure><figcaption>" + html_escaped(result.item.name) + ": l1 " + anigen::fixed(score.l1) +
                     ", l2 " + anigen::fixed(score.l2) + ", KL " + anigen::fixed(score.kl) + "; " +
                     std::to_string(result.joints) + " joints, " + std::to_string(result.vertices) +
                     " vertices</figcaption>\n";
  try {
    const GroundTruth truth = read_ground_truth(options.dataset, result.item.id);
    const io::Image image =
        compare(truth, evaluation.methods[0].predict(result.item, truth), evaluation.methods[0], options.picture_size);
    text += "<img alt=\"\" src=\"data:image/png;base64," + base64(io::encode_png(image)) + "\">";
  } catch (...) {
    text += "<p>No picture: " + html_escaped(failure_of_item()) + "</p>";
  }
  return text + "</figure>\n";
}

/// Indices of the usable assets with scores, worst first.
std::vector<std::size_t> by_error(const SkinEvaluation& evaluation) {
  std::vector<std::size_t> order;
  for (std::size_t i = 0; i < evaluation.assets.size(); ++i) {
    if (evaluation.assets[i].item.usable && evaluation.assets[i].methods[0].failure.empty()) order.push_back(i);
  }
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return evaluation.assets[a].methods[0].scores.mean.l1 > evaluation.assets[b].methods[0].scores.mean.l1;
  });
  return order;
}

std::string pictures(const SkinEvaluation& evaluation, const ReportOptions& options) {
  const std::vector<std::size_t> order = by_error(evaluation);
  const std::size_t worst = std::min(options.pictured, order.size());
  const std::size_t best = std::min(options.pictured, order.size() - worst);
  std::string text;
  if (worst > 0) text += "<h2>Worst assets</h2>\n";
  for (std::size_t i = 0; i < worst; ++i) text += figure(evaluation, evaluation.assets[order[i]], options);
  if (best > 0) text += "<h2>Best assets</h2>\n";
  for (std::size_t i = 0; i < best; ++i)
    text += figure(evaluation, evaluation.assets[order[order.size() - 1 - i]], options);
  return text;
}

std::string curves(const fs::path& metrics) {
  std::error_code ignored;
  if (metrics.empty() || !fs::exists(metrics, ignored)) return "";
  const CsvTable table = read_csv(metrics);
  const std::size_t step = table.column("step");
  std::string text;
  for (std::size_t c = 0; step != CsvTable::kMissing && c < table.columns.size(); ++c) {
    if (table.columns[c].rfind("eval", 0) != 0) continue;
    std::vector<std::pair<double, double>> points;
    for (const auto& row : table.rows) {
      if (!row[c].empty())
        points.emplace_back(std::strtod(row[step].c_str(), nullptr), std::strtod(row[c].c_str(), nullptr));
    }
    text += line_chart(table.columns[c] + " by training step", points);
  }
  return text.empty() ? "" : "<h2>During training</h2>\n" + text;
}

std::string settings_list(const Json& settings) {
  std::string text = "<ul>\n";
  for (const auto& [key, value] : settings.items()) {
    text += "<li>" + html_escaped(key) + ": <code>" +
            html_escaped(value.is_string() ? value.get<std::string>() : value.dump()) + "</code></li>\n";
  }
  return text + "</ul>\n";
}

}  // namespace

std::string skin_report(const SkinEvaluation& evaluation, const ReportOptions& options) {
  std::string html = "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>" +
                     html_escaped(options.title) + "</title><style>" + kStyle + "</style></head><body>\n<h1>" +
                     html_escaped(options.title) + "</h1>\n";
  html += settings_list(evaluation.settings);
  html +=
      "<p>Per vertex, l1 is the sum of absolute differences over joints (0 to 2), l2 the norm of the differences, KL "
      "the divergence of the prediction from the ground truth in nats; means over vertices, then over assets. Columns "
      "with a number of influences are l1 over the vertices that so many joints truly move. Oracles look at the true "
      "weights.</p>\n";
  html += "<h2>" + std::to_string(count(evaluation, Group::kUsable)) + " usable assets</h2>\n" +
          anigen::to_html(summary_table(evaluation, Group::kUsable));
  if (evaluation.poses > 0)
    html +=
        "<h2>Means over skeletons</h2>\n<p>Each skeleton counts once, with half of 95 % intervals over skeletons."
        "</p>\n" +
        anigen::to_html(skeleton_table(evaluation));
  html += curves(options.training_metrics);
  html += pictures(evaluation, options);
  html += "<h2>All usable assets, " + html_escaped(evaluation.methods[0].label) + "</h2>\n" +
          anigen::to_html(asset_table(evaluation, Group::kUsable));
  if (count(evaluation, Group::kNotUsable) > 0) {
    html +=
        "<h2>Not usable, scored apart</h2>\n<p>Too few or too many joints, or joints with equal vectors from their "
        "parents.</p>\n" +
        anigen::to_html(summary_table(evaluation, Group::kNotUsable)) +
        anigen::to_html(asset_table(evaluation, Group::kNotUsable));
  }
  return html + "</body></html>\n";
}

}  // namespace anigen::eval
