#include <algorithm>
#include <cmath>
#include <map>

#include "anigen/eval/comparison/comparison_files.h"

namespace anigen::eval {
namespace {

/// Resampling a handful of differences says nothing about others.
constexpr std::size_t kFewestForVerdict = 6;

int digits(const MetricInfo& metric) {
  return metric.unit == "joints" || metric.unit == "edits" || metric.unit == "dB" ? 2 : 4;
}

std::string head(const MetricInfo& metric) {
  const std::string mark = arrow(metric.better);
  return mark.empty() ? metric.label : metric.label + " " + mark;
}

}  // namespace

Table method_table(const Comparison& comparison, const std::vector<const MetricInfo*>& metrics) {
  Table table;
  table.columns = {"method", "assets", "failed"};
  for (const MetricInfo* metric : metrics) table.columns.push_back(head(*metric));
  for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
    table.rows.push_back(
        {comparison.methods[m], std::to_string(comparison.ids.size()), std::to_string(failures(comparison, m))});
  }
  for (const MetricInfo* metric : metrics) {
    const std::vector<int> rank = ranks(comparison, *metric);
    for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
      const Summary summary = summarize_metric(comparison, m, metric->key).summary;
      std::string cell = summary.n == 0 ? "–" : fixed(summary.mean, digits(*metric));
      if (summary.n > 0 && summary.n + failures(comparison, m) < comparison.ids.size())
        cell += " (n " + std::to_string(summary.n) + ")";
      if (rank[m] == 1) cell = "**" + cell + "**";
      if (rank[m] == 2) cell = "_" + cell + "_";
      table.rows[m].push_back(cell);
    }
  }
  return table;
}

Table metric_summary_table(const Comparison& comparison, std::size_t method) {
  Table table;
  table.columns = {"metric", "key", "unit", "mean", "median", "std", "95 % of the mean", "assets"};
  for (const MetricInfo* metric : present_metrics(comparison, false)) {
    const MetricSummary summary = summarize_metric(comparison, method, metric->key);
    const int places = digits(*metric);
    table.rows.push_back({head(*metric), metric->key, metric->unit, fixed(summary.summary.mean, places),
                          fixed(summary.summary.median, places), fixed(summary.summary.std, places),
                          fixed(summary.interval.low, places) + " – " + fixed(summary.interval.high, places),
                          std::to_string(summary.summary.n)});
  }
  return table;
}

Table pairing_table(const Comparison& comparison) {
  constexpr std::size_t kNamed = 5;
  const auto counted = [&](const std::vector<std::string>& names) {
    std::string text = std::to_string(names.size());
    for (std::size_t i = 0; i < std::min(kNamed, names.size()); ++i) text += (i == 0 ? ": " : ", ") + names[i];
    return text + (names.size() > kNamed ? ", …" : "");
  };
  Table table;
  table.columns = {"method", "ground truths", "paired", "without a prediction", "unused predictions"};
  for (std::size_t m = 0; m < comparison.pairing.size(); ++m) {
    const Pairing& pairing = comparison.pairing[m];
    table.rows.push_back({comparison.methods[m], std::to_string(pairing.paired + pairing.missing.size()),
                          std::to_string(pairing.paired), counted(pairing.missing), counted(pairing.unused)});
  }
  return table;
}

Table reason_table(const Comparison& comparison) {
  Table table;
  table.columns = {"method", "what", "reason", "assets"};
  for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
    for (const PairResult& result : comparison.results[m]) {
      if (!result.failure.empty()) table.rows.push_back({comparison.methods[m], result.id, result.failure, "1"});
    }
    // Metrics that miss for the same reason share a line.
    std::map<std::string, std::map<std::string, std::size_t>> by_reason;
    for (const PairResult& result : comparison.results[m]) {
      for (const auto& [key, reason] : result.not_computed) ++by_reason[reason][key];
    }
    for (const auto& [reason, keys] : by_reason) {
      std::string what;
      std::size_t most = 0;
      for (const auto& [key, count] : keys) {
        what += (what.empty() ? "" : ", ") + key;
        most = std::max(most, count);
      }
      table.rows.push_back({comparison.methods[m], what, reason, std::to_string(most)});
    }
  }
  return table;
}

Table difference_table(const Comparison& comparison) {
  Table table;
  table.columns = {"method", "metric", "mean difference", "95 %", "assets", "reads"};
  for (std::size_t m = 1; m < comparison.methods.size(); ++m) {
    for (const MetricInfo* metric : present_metrics(comparison, true)) {
      const PairedDifference difference =
          paired_difference(metric_values(comparison, m, metric->key), metric_values(comparison, 0, metric->key),
                            comparison.seed, metric->key);
      if (difference.n == 0) continue;
      const bool clear = difference.interval.low > 0 || difference.interval.high < 0;
      const bool lower_wins = metric->better == Better::kLower;
      const std::string verdict = difference.equal                      ? "equal"
                                  : difference.n < kFewestForVerdict    ? "too few assets to tell"
                                  : !clear                              ? "no clear difference"
                                  : (difference.mean < 0) == lower_wins ? "better"
                                                                        : "worse";
      const int places = digits(*metric);
      table.rows.push_back({comparison.methods[m] + " − " + comparison.methods[0], head(*metric),
                            fixed(difference.mean, places),
                            fixed(difference.interval.low, places) + " – " + fixed(difference.interval.high, places),
                            std::to_string(difference.n), verdict});
    }
  }
  return table;
}

}  // namespace anigen::eval
