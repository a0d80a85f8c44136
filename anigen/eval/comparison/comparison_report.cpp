#include "anigen/eval/comparison/comparison_report.h"

#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/core/html.h"
#include "anigen/eval/comparison/comparison_files.h"
#include "anigen/eval/comparison/report_page.h"
#include "anigen/eval/comparison/report_shapes.h"

namespace anigen::eval {
namespace {

const MetricInfo* ordering_metric(const Comparison& comparison, const std::string& wanted) {
  if (!wanted.empty()) {
    const MetricInfo* metric = find_metric(wanted);
    if (metric == nullptr)
      throw InputError("", wanted, "no such metric to order assets by; docs/metrics.md lists them");
    return metric;
  }
  const std::vector<const MetricInfo*> present = present_metrics(comparison, true);
  return present.empty() ? nullptr : present.front();
}

/// Assets of a method, worst first: failures, then by the metric, then those without a value.
std::vector<std::size_t> worst_first(const Comparison& comparison, std::size_t method, const MetricInfo* metric) {
  const auto& results = comparison.results[method];
  std::vector<std::size_t> order(results.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  const auto badness = [&](std::size_t i) {
    if (!results[i].failure.empty()) return 1e300;
    const double value = metric == nullptr ? NAN : results[i].value(metric->key);
    if (!std::isfinite(value)) return -1e300;
    return metric->better == Better::kHigher ? -value : value;
  };
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return badness(a) > badness(b); });
  return order;
}

std::string asset_rows(const Comparison& comparison, const MetricInfo* metric) {
  const std::vector<const MetricInfo*> metrics = present_metrics(comparison, false);
  std::string text = "<div class=\"wide\"><table class=\"sortable\"><thead><tr><th>asset</th><th>method</th>";
  for (const MetricInfo* column : metrics)
    text += "<th title=\"" + html_escaped(column->key + ", " + column->unit) + "\">" +
            html_escaped(column->label + " " + arrow(column->better)) + "</th>";
  text += "<th>reason</th></tr></thead><tbody>\n";
  for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
    for (const std::size_t i : worst_first(comparison, m, metric)) {
      const PairResult& result = comparison.results[m][i];
      text += "<tr><td>" + html_escaped(result.id) + "</td><td>" + html_escaped(comparison.methods[m]) + "</td>";
      for (const MetricInfo* column : metrics) text += "<td>" + fixed(result.value(column->key)) + "</td>";
      text += "<td class=\"failed\">" + html_escaped(result.failure) + "</td></tr>\n";
    }
  }
  return text + "</tbody></table></div>\n";
}

std::string caption(const Comparison& comparison, std::size_t method, const PairResult& result) {
  std::string text = "<figcaption><b>" + html_escaped(result.id) + "</b>, " + html_escaped(comparison.methods[method]);
  for (const MetricInfo* metric : present_metrics(comparison, true)) {
    const double value = result.value(metric->key);
    if (std::isfinite(value)) text += " · " + html_escaped(metric->label) + " " + fixed(value);
  }
  return text + "</figcaption>\n";
}

std::string pictures(const Comparison& comparison, const ComparisonReportOptions& options, const MetricInfo* metric) {
  if (!options.shapes || options.pictured == 0) return "";
  std::string text;
  for (std::size_t m = 0; m < comparison.methods.size(); ++m) {
    std::string figures;
    std::size_t drawn = 0;
    for (const std::size_t i : worst_first(comparison, m, metric)) {
      const PairResult& result = comparison.results[m][i];
      if (drawn == options.pictured) break;
      if (!result.failure.empty()) continue;
      ++drawn;
      figures += "<figure>" + caption(comparison, m, result);
      try {
        const ComparedShapes shapes = options.shapes(m, i);
        figures += turntable_html(shapes, options.views, options.picture_size);
        figures += posed_html(shapes, options.poses, options.picture_size, comparison.seed);
        figures += view_html(shapes, "shape-" + std::to_string(m) + "-" + std::to_string(i));
      } catch (...) {
        figures += "<p class=\"failed\">No picture: " + html_escaped(failure_of_item()) + "</p>";
      }
      figures += "</figure>\n";
    }
    if (!figures.empty()) text += "<h2>Worst first, " + html_escaped(comparison.methods[m]) + "</h2>\n" + figures;
  }
  return text;
}

std::string motions(const std::vector<MotionStrip>& strips) {
  if (strips.empty()) return "";
  std::string text =
      "<h2>The same motion</h2>\n<p class=\"hint\">Ground truth and predictions at the same times, each in the colours "
      "of its own joints; drag to move by hand.</p>\n";
  for (const MotionStrip& strip : strips) text += motion_html(strip);
  return text;
}

std::string settings_html(const Json& settings) {
  return "<details><summary>Settings, seeds, versions</summary><pre>" + html_escaped(settings.dump(2)) +
         "</pre></details>\n";
}

std::string section(const std::string& title, const Table& table) {
  if (table.rows.empty()) return "";
  return "<h2>" + html_escaped(title) + "</h2>\n<div class=\"wide\">" + to_html(table) + "</div>\n";
}

}  // namespace

std::vector<std::size_t> worst_first(const Comparison& comparison, std::size_t method, const std::string& worst_by) {
  return worst_first(comparison, method, ordering_metric(comparison, worst_by));
}

std::string comparison_report(const Comparison& comparison, const ComparisonReportOptions& options) {
  const MetricInfo* metric = ordering_metric(comparison, options.worst_by);
  std::string html = page_begin(options.title) + settings_html(comparison.settings);
  html += section(std::to_string(comparison.ids.size()) + " ground truths",
                  method_table(comparison, present_metrics(comparison, true)));
  const std::string transport = transport_text(comparison);
  if (!transport.empty()) html += "<p class=\"hint\">" + html_escaped(transport) + "</p>\n";
  html += section("Pairs", pairing_table(comparison));
  html += section("Differences to " + comparison.methods[0], difference_table(comparison));
  html += motions(options.motions);
  html += pictures(comparison, options, metric);
  html += "<h2>All assets</h2>\n<p class=\"hint\">Worst first" +
          (metric == nullptr ? "" : " by " + html_escaped(metric->label)) + "; click a column to sort.</p>\n" +
          asset_rows(comparison, metric);
  for (std::size_t m = 0; m < comparison.methods.size(); ++m)
    html += section("All metrics, " + comparison.methods[m], metric_summary_table(comparison, m));
  html += section("Not computed", reason_table(comparison));
  return html + page_end();
}

}  // namespace anigen::eval
