#include "anigen/eval/report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iterator>

#include "anigen/core/chart.h"
#include "anigen/core/error.h"
#include "anigen/core/hash.h"
#include "anigen/core/table.h"
#include "anigen/render/contact_sheet.h"
#include "anigen/render/picture.h"

namespace anigen::eval {

namespace {

namespace fs = std::filesystem;

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
