#include "anigen/train/progress_page.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <map>
#include <system_error>
#include <utility>
#include <vector>

#include "anigen/core/chart.h"
#include "anigen/core/files.h"

namespace anigen::train {

namespace {

namespace fs = std::filesystem;

using Points = std::vector<std::pair<double, double>>;

constexpr double kMissing = std::numeric_limits<double>::quiet_NaN();

double number(const CsvTable& table, std::size_t row, const std::string& column) {
  const std::string& cell = table.cell(row, column);
  return cell.empty() ? kMissing : std::strtod(cell.c_str(), nullptr);
}

// A column against samples, or against hours of training.
Points points_of(const CsvTable& metrics, const std::string& column, const RunFacts& facts, bool by_hours) {
  Points points;
  for (std::size_t row = 0; row < metrics.rows.size(); ++row) {
    const double value = number(metrics, row, column);
    if (!std::isfinite(value)) continue;
    const double x = by_hours ? number(metrics, row, "time.elapsed_s") / 3600.0
                              : number(metrics, row, "step") * static_cast<double>(facts.batch_size);
    points.emplace_back(x, value);
  }
  return points;
}

bool starts_with(const std::string& text, const char* with) { return text.rfind(with, 0) == 0; }

std::string charts(const CsvTable& metrics, const char* prefix, const RunFacts& facts, bool by_hours) {
  std::string html;
  for (const std::string& column : metrics.columns) {
    if (!starts_with(column, prefix)) continue;
    html += line_chart(column + (by_hours ? " by hours" : " by samples"), points_of(metrics, column, facts, by_hours));
  }
  return html;
}

std::int64_t step_of(const fs::path& folder) {
  const std::string name = folder.filename().string();
  return starts_with(name, "step") ? std::strtoll(name.c_str() + 4, nullptr, 10) : -1;
}

// Pictures of the folder of the latest step, by their paths below the run.
std::string newest_pictures(const RunFolder& run) {
  constexpr std::size_t kMost = 24;
  std::error_code error;
  fs::path newest;
  for (const fs::directory_entry& entry : fs::directory_iterator(run.samples(), error)) {
    if (step_of(entry.path()) > (newest.empty() ? -1 : step_of(newest))) newest = entry.path();
  }
  if (newest.empty()) return "";
  std::string html = "<h2>Samples of step " + std::to_string(step_of(newest)) + "</h2>\n";
  std::vector<std::string> pictures;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(newest, error)) {
    if (entry.path().extension() == ".png") pictures.push_back(entry.path().lexically_relative(run.root).string());
  }
  std::sort(pictures.begin(), pictures.end());
  if (pictures.size() > kMost) pictures.resize(kMost);
  for (const std::string& picture : pictures) {
    html += "<figure><img src=\"" + html_escaped(picture) + "\"><figcaption>" + html_escaped(picture) +
            "</figcaption></figure>\n";
  }
  return html;
}

std::string hours_text(double seconds) {
  char text[32];
  std::snprintf(text, sizeof text, "%.2f h", seconds / 3600.0);
  return text;
}

}  // namespace

std::string progress_page(const RunFolder& run, const CsvTable& metrics, const RunFacts& facts) {
  const std::size_t rows = metrics.rows.size();
  const double step = rows == 0 ? 0.0 : number(metrics, rows - 1, "step");
  double elapsed = 0.0;
  for (std::size_t row = 0; row < rows; ++row) {
    const double seconds = number(metrics, row, "time.elapsed_s");
    if (std::isfinite(seconds)) elapsed = seconds;
  }
  const double left = step > 0.0 ? elapsed * (static_cast<double>(facts.max_steps) - step) / step : 0.0;
  std::string html =
      "<!doctype html>\n<meta charset=\"utf-8\"><title>" + html_escaped(facts.title) +
      "</title>\n<style>body{font:15px/1.45 sans-serif;max-width:1300px;margin:2em auto;padding:0 1em;color:#222}"
      "svg{margin:.4em}figure{display:inline-block;margin:.5em}img{max-width:400px}figcaption{font-size:12px}</style>\n"
      "<h1>" +
      html_escaped(facts.title) + "</h1>\n<p>Step " + std::to_string(std::llround(step)) + " of " +
      std::to_string(facts.max_steps) + ", " +
      std::to_string(std::llround(step * static_cast<double>(facts.batch_size))) + " samples, " + hours_text(elapsed) +
      " of training" + (left > 0.0 ? ", about " + hours_text(left) + " left" : std::string()) + ".</p>\n";
  html +=
      "<h2>Held-out metrics</h2>\n" + charts(metrics, "eval.", facts, false) + charts(metrics, "eval.", facts, true);
  html += "<h2>Losses</h2>\n" + charts(metrics, "loss.", facts, false);
  html += "<h2>Learning rate, gradients, speed</h2>\n" + charts(metrics, "status.", facts, false) +
          charts(metrics, "time.samples_per_s", facts, false);
  return html + newest_pictures(run);
}

bool has_stalled(const CsvTable& metrics, const std::string& quantity, std::int64_t patience, double gain) {
  std::vector<double> values;
  for (std::size_t row = 0; row < metrics.rows.size(); ++row) {
    const double value = number(metrics, row, quantity);
    if (std::isfinite(value)) values.push_back(value);
  }
  const auto recent = static_cast<std::size_t>(std::max<std::int64_t>(1, patience));
  if (values.size() <= recent) return false;
  const auto middle = values.end() - static_cast<std::ptrdiff_t>(recent);
  const double before = *std::min_element(values.begin(), middle), since = *std::min_element(middle, values.end());
  return since > before * (1.0 - gain);
}

}  // namespace anigen::train
