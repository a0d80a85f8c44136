#include <cmath>

#include "anigen/eval/comparison/comparison_files.h"

namespace anigen::eval {
namespace {

Json summary_json(const Comparison& comparison, std::size_t method) {
  Json summary = Json::object();
  for (const MetricInfo& metric : metric_table()) {
    const MetricSummary of = summarize_metric(comparison, method, metric.key);
    if (of.summary.n == 0) {
      summary[metric.key] = {{"mean", nullptr}, {"median", nullptr}, {"std", nullptr}, {"n", 0}};
      continue;
    }
    summary[metric.key] = {{"mean", of.summary.mean}, {"median", of.summary.median}, {"std", of.summary.std},
                           {"n", of.summary.n},       {"low", of.interval.low},      {"high", of.interval.high}};
  }
  return summary;
}

Json asset_json(const PairResult& result) {
  Json json = {{"id", result.id}};
  if (!result.failure.empty()) json["failure"] = result.failure;
  // A failed asset has no values; every other one says of each metric what it is or why it is not there.
  for (const MetricInfo& metric : metric_table()) {
    const double value = result.value(metric.key);
    json[metric.key] = std::isfinite(value) ? Json(value) : Json(nullptr);
  }
  json["not_computed"] = result.not_computed;
  json["notes"] = result.notes;
  json["details"] = result.details;
  return json;
}

Json assets_json(const Comparison& comparison, std::size_t method) {
  Json assets = Json::array();
  for (const PairResult& result : comparison.results[method]) assets.push_back(asset_json(result));
  return assets;
}

}  // namespace

Json to_json(const Comparison& comparison) {
  Json json;
  json["settings"] = comparison.settings;
  json["method"] = comparison.methods[0];
  json["summary"] = summary_json(comparison, 0);
  json["failed"] = failures(comparison, 0);
  json["assets"] = assets_json(comparison, 0);
  json["methods"] = Json::object();
  json["differences"] = Json::object();
  for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
    json["methods"][comparison.methods[m]] = {{"summary", summary_json(comparison, m)},
                                              {"failed", failures(comparison, m)},
                                              {"assets", assets_json(comparison, m)}};
    if (m == 0) continue;
    Json& differences = json["differences"][comparison.methods[m]];
    differences = Json::object();
    for (const MetricInfo& metric : metric_table()) {
      const PairedDifference of =
          paired_difference(metric_values(comparison, m, metric.key), metric_values(comparison, 0, metric.key),
                            comparison.seed, metric.key);
      if (of.n > 0)
        differences[metric.key] = {
            {"mean", of.mean}, {"low", of.interval.low}, {"high", of.interval.high}, {"n", of.n}, {"equal", of.equal}};
    }
  }
  json["unused_predictions"] = comparison.unused;
  for (std::size_t m = 0; m < comparison.pairing.size(); ++m) {
    const Pairing& pairing = comparison.pairing[m];
    json["pairing"][comparison.methods[m]] = {
        {"paired", pairing.paired}, {"missing", pairing.missing}, {"unused", pairing.unused}};
  }
  return json;
}

CsvTable to_csv_table(const Comparison& comparison) {
  CsvTable table;
  table.columns = {"id", "method", "failure"};
  for (const MetricInfo& metric : metric_table()) table.columns.push_back(metric.key);
  for (std::size_t i = 0; i < comparison.ids.size(); ++i) {
    for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
      const PairResult& result = comparison.results[m][i];
      std::vector<std::string> row = {result.id, comparison.methods[m], result.failure};
      for (const MetricInfo& metric : metric_table()) {
        const double value = result.value(metric.key);
        row.push_back(std::isfinite(value) ? Json(value).dump() : "");
      }
      table.rows.push_back(std::move(row));
    }
  }
  return table;
}

}  // namespace anigen::eval
