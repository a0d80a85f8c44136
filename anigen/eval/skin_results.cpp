#include "anigen/eval/skin_results.h"

#include <algorithm>
#include <cstdio>
#include <limits>

namespace anigen::eval {
namespace {

constexpr std::array<const char*, kInfluenceClasses> kClassNames = {"1", "2", "3", "4", "5+"};

Json to_json(const Summary& summary) {
  // No value is not a value of zero.
  if (summary.n == 0) return {{"mean", nullptr}, {"median", nullptr}, {"std", nullptr}, {"n", 0}};
  return {{"mean", summary.mean}, {"median", summary.median}, {"std", summary.std}, {"n", summary.n}};
}

Json to_json(const std::array<Summary, 3>& summaries) {
  Json json = Json::object();
  for (std::size_t k = 0; k < 3; ++k) json[kScoreNames[k]] = to_json(summaries[k]);
  return json;
}

Json by_influences(const SkinEvaluation& evaluation, std::size_t method) {
  Json json = Json::object();
  for (std::size_t c = 0; c < kInfluenceClasses; ++c) {
    json[kClassNames[c]] = to_json(summarize_class(evaluation, method, Group::kUsable, c));
  }
  return json;
}

void put_scores(Json& json, const SkinScore& score) {
  const auto values = score_values(score);
  for (std::size_t k = 0; k < 3; ++k) json[kScoreNames[k]] = values[k];
}

Json asset_json(const AssetResult& asset, std::size_t method) {
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
  for (std::size_t c = 0; c < kInfluenceClasses; ++c) {
    if (result.scores.class_sizes[c] == 0) continue;
    Json group = {{"vertices", result.scores.class_sizes[c]}};
    put_scores(group, result.scores.by_influences[c]);
    json["by_influences"][kClassNames[c]] = group;
  }
  return json;
}

Json method_json(const SkinEvaluation& evaluation, std::size_t method) {
  Json assets = Json::array();
  for (const AssetResult& asset : evaluation.assets) assets.push_back(asset_json(asset, method));
  return {{"summary", to_json(summarize(evaluation, method, Group::kUsable))},
          {"by_influences", by_influences(evaluation, method)},
          {"not_usable", to_json(summarize(evaluation, method, Group::kNotUsable))},
          {"assets", assets}};
}

std::string mean_or_dash(const Summary& summary) {
  return fixed(summary.n > 0 ? summary.mean : std::numeric_limits<double>::quiet_NaN());
}

}  // namespace

Json to_json(const SkinEvaluation& evaluation) {
  Json json = {{"settings", evaluation.settings}};
  json["settings"]["kl_epsilon"] = kKlEpsilon;
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
    json["methods"][evaluation.methods[m].key] = one;
  }
  return json;
}

CsvTable to_csv_table(const SkinEvaluation& evaluation) {
  CsvTable table;
  table.columns = {"id", "name", "source", "usable", "method", "joints", "vertices", "skin_l1", "skin_l2", "skin_kl"};
  for (const char* name : kClassNames) table.columns.push_back(std::string("skin_l1_influences_") + name);
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
      for (std::size_t c = 0; c < kInfluenceClasses; ++c) {
        const bool absent = failed || result.scores.class_sizes[c] == 0;
        row.push_back(absent ? "" : number(result.scores.by_influences[c].l1));
      }
      row.push_back(result.failure);
      table.rows.push_back(std::move(row));
    }
  }
  return table;
}

Table summary_table(const SkinEvaluation& evaluation, Group group) {
  Table table;
  table.columns = {"method", "l1", "l2", "KL", "median l1"};
  for (const char* name : kClassNames) table.columns.push_back("l1, " + std::string(name) + " infl.");
  table.columns.push_back("assets");
  for (std::size_t m = 0; m < evaluation.methods.size(); ++m) {
    const auto scores = summarize(evaluation, m, group);
    std::vector<std::string> row = {evaluation.methods[m].label};
    for (const Summary& score : scores) row.push_back(mean_or_dash(score));
    row.push_back(scores[0].n > 0 ? fixed(scores[0].median) : "–");
    for (std::size_t c = 0; c < kInfluenceClasses; ++c)
      row.push_back(mean_or_dash(summarize_class(evaluation, m, group, c)[0]));
    row.push_back(std::to_string(scores[0].n));
    table.rows.push_back(std::move(row));
  }
  return table;
}

Table asset_table(const SkinEvaluation& evaluation, Group group) {
  std::vector<const AssetResult*> order;
  for (const AssetResult& asset : evaluation.assets) {
    if (asset.item.usable == (group == Group::kUsable)) order.push_back(&asset);
  }
  std::stable_sort(order.begin(), order.end(), [](const AssetResult* a, const AssetResult* b) {
    const bool a_failed = !a->methods[0].failure.empty(), b_failed = !b->methods[0].failure.empty();
    if (a_failed != b_failed) return b_failed;
    return a->methods[0].scores.mean.l1 > b->methods[0].scores.mean.l1;
  });
  Table table;
  table.columns = {"asset", "joints", "vertices", "l1", "l2", "KL", "note"};
  for (const AssetResult* asset : order) {
    const MethodResult& result = asset->methods[0];
    std::vector<std::string> row = {asset->item.name, std::to_string(asset->joints), std::to_string(asset->vertices)};
    for (const double value : score_values(result.scores.mean))
      row.push_back(result.failure.empty() ? fixed(value) : "–");
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
  Table failures{{"asset", "method", "reason"}, {}};
  for (const AssetResult& asset : evaluation.assets) {
    for (std::size_t m = 0; m < evaluation.methods.size(); ++m) {
      if (asset.methods[m].failure.empty()) continue;
      failures.rows.push_back({asset.item.name, evaluation.methods[m].label, asset.methods[m].failure});
    }
  }
  if (!failures.rows.empty()) text += "\nWithout scores\n\n" + to_markdown(failures);
  return text;
}

}  // namespace anigen::eval
