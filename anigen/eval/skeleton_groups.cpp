#include "anigen/eval/skeleton_groups.h"

#include <cmath>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "anigen/eval/metric_table.h"

namespace anigen::eval {

namespace {

/// Joint tree of each truth, as evaluate_pair() notes it; empty where no method says.
std::vector<std::string> trees_of(const Comparison& comparison) {
  std::vector<std::string> trees(comparison.ids.size());
  for (const std::vector<PairResult>& method : comparison.results) {
    for (std::size_t i = 0; i < trees.size(); ++i) {
      if (trees[i].empty() && method[i].details.is_object()) trees[i] = method[i].details.value("skeleton", "");
    }
  }
  return trees;
}

PairResult mean_result(const std::vector<PairResult>& results, const std::vector<std::size_t>& assets) {
  PairResult mean;
  for (const MetricInfo& metric : metric_table()) {
    double sum = 0.0;
    std::size_t count = 0;
    for (const std::size_t i : assets) {
      const double value = results[i].value(metric.key);
      if (!std::isfinite(value)) continue;
      sum += value;
      ++count;
    }
    if (count > 0) mean.set(metric.key, sum / static_cast<double>(count));
  }
  if (mean.values.empty()) mean.failure = "no asset of this skeleton has a value";
  return mean;
}

}  // namespace

std::vector<std::string> independent_units(const Comparison& comparison) {
  std::vector<std::string> units = trees_of(comparison);
  std::set<std::string> known;
  std::size_t told = 0;
  for (std::size_t i = 0; i < units.size(); ++i) {
    if (!units[i].empty()) known.insert(units[i]), ++told;
    if (units[i].empty()) units[i] = "asset " + std::to_string(i);
  }
  if (known.size() == told) units.clear();
  return units;
}

std::optional<Comparison> by_skeleton(const Comparison& comparison) {
  const std::vector<std::string> trees = trees_of(comparison);
  std::map<std::string, std::vector<std::size_t>> assets;
  std::size_t known = 0;
  for (std::size_t i = 0; i < trees.size(); ++i) {
    if (trees[i].empty()) continue;
    assets[trees[i]].push_back(i);
    ++known;
  }
  if (assets.size() == known) return std::nullopt;
  Comparison skeletons;
  skeletons.methods = comparison.methods;
  skeletons.settings = comparison.settings;
  skeletons.seed = comparison.seed;
  skeletons.results.resize(comparison.methods.size());
  for (const auto& [tree, members] : assets) {
    skeletons.ids.push_back(tree);
    for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
      skeletons.results[m].push_back(mean_result(comparison.results[m], members));
      skeletons.results[m].back().id = tree;
    }
  }
  return skeletons;
}

Table skeleton_mean_table(const Comparison& skeletons, const Comparison& comparison) {
  const std::vector<const MetricInfo*> metrics = present_metrics(skeletons, true);
  Table table{{"method", "skeletons", "assets"}, {}};
  for (const MetricInfo* metric : metrics) table.columns.push_back(column_head(*metric));
  for (std::size_t m = 0; m < skeletons.methods.size(); ++m) {
    std::vector<std::string> row{skeletons.methods[m], std::to_string(skeletons.ids.size() - failures(skeletons, m)),
                                 std::to_string(comparison.ids.size() - failures(comparison, m))};
    for (const MetricInfo* metric : metrics) {
      const MetricSummary of = summarize_metric(skeletons, m, metric->key);
      row.push_back(
          of.summary.n == 0 ? "–" : fixed(of.summary.mean) + " ± " + fixed(0.5 * (of.interval.high - of.interval.low)));
    }
    table.rows.push_back(std::move(row));
  }
  return table;
}

Json skeleton_json(const Comparison& skeletons) {
  Json methods = Json::object();
  for (std::size_t m = 0; m < skeletons.methods.size(); ++m) {
    Json& values = methods[skeletons.methods[m]] = Json::object();
    for (const MetricInfo* metric : present_metrics(skeletons, false)) {
      const MetricSummary of = summarize_metric(skeletons, m, metric->key);
      if (of.summary.n > 0)
        values[metric->key] = {
            {"mean", of.summary.mean}, {"low", of.interval.low}, {"high", of.interval.high}, {"n", of.summary.n}};
    }
  }
  return {{"skeletons", skeletons.ids.size()}, {"methods", std::move(methods)}};
}

}  // namespace anigen::eval
