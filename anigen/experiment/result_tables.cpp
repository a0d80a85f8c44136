#include "anigen/experiment/result_tables.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "anigen/experiment/estimate.h"
#include "anigen/experiment/job_record.h"

namespace anigen::experiment {
namespace {

/// Place of every row by mean: 1 best, 2 second, equal ones alike; 0 for the others and where nothing can be ranked.
std::vector<int> ranks(const ResultTable& result, std::size_t column) {
  const Column::Better better = result.spec.columns[column].better;
  const std::vector<std::string>& references = result.spec.not_ranked;
  std::vector<double> means;
  std::size_t ranked = 0;
  for (const Row& row : result.rows) {
    const bool is_reference = std::find(references.begin(), references.end(), row.method) != references.end();
    const bool has = row.cells[column].has() && !is_reference;
    means.push_back(has ? row.cells[column].mean : std::numeric_limits<double>::quiet_NaN());
    ranked += has ? 1 : 0;
  }
  if (better == Column::Better::kNone || ranked < 2) return std::vector<int>(result.rows.size(), 0);
  return eval::places(means, better == Column::Better::kLower);
}

std::string head(const Column& column) {
  return column.label + (column.better == Column::Better::kLower    ? " ↓"
                         : column.better == Column::Better::kHigher ? " ↑"
                                                                    : "");
}

std::string mean_text(const Cell& cell, int digits) {
  if (!cell.has()) return "–";
  return eval::fixed(cell.mean, digits) + " ± " + eval::fixed((cell.interval.high - cell.interval.low) / 2, digits);
}

bool named_variants(const ResultTable& result) {
  return std::any_of(result.rows.begin(), result.rows.end(), [](const Row& row) { return !row.variant.empty(); });
}

}  // namespace

eval::Table mean_table(const ResultTable& result) {
  eval::Table table;
  const bool variants = named_variants(result);
  if (variants) table.columns.emplace_back("variant");
  table.columns.insert(table.columns.end(), {"method", "assets", "failed"});
  for (const Column& column : result.spec.columns) table.columns.push_back(head(column));
  for (const Row& row : result.rows) {
    std::vector<std::string> cells;
    if (variants) cells.push_back(row.variant);
    cells.insert(cells.end(), {row.method, std::to_string(row.assets), std::to_string(row.failed)});
    table.rows.push_back(std::move(cells));
  }
  for (std::size_t c = 0; c < result.spec.columns.size(); ++c) {
    const std::vector<int> rank = ranks(result, c);
    for (std::size_t r = 0; r < result.rows.size(); ++r) {
      std::string text = mean_text(result.rows[r].cells[c], result.spec.columns[c].digits);
      if (rank[r] == 1) text = "**" + text + "**";
      if (rank[r] == 2) text = "_" + text + "_";
      table.rows[r].push_back(std::move(text));
    }
  }
  return table;
}

eval::Table difference_table(const ResultTable& result) {
  eval::Table table;
  table.columns = {"variant", "against", "method"};
  for (const Column& column : result.spec.columns) table.columns.push_back(head(column));
  for (const Difference& difference : result.differences) {
    const Row& row = result.rows[difference.row];
    std::vector<std::string> cells{row.variant, result.rows[difference.against].variant, row.method};
    for (std::size_t c = 0; c < difference.columns.size(); ++c) {
      const eval::PairedDifference& of = difference.columns[c];
      const int digits = result.spec.columns[c].digits;
      std::string text = "–";
      if (of.equal) {
        text = "equal";
      } else if (of.n > 0) {
        text = (of.mean >= 0 ? "+" : "") + eval::fixed(of.mean, digits) + " [" + eval::fixed(of.interval.low, digits) +
               ", " + eval::fixed(of.interval.high, digits) + "]";
        if (std::isfinite(difference.p[c])) text += ", p " + eval::fixed(difference.p[c], 4);
      }
      cells.push_back(text);
    }
    table.rows.push_back(std::move(cells));
  }
  return table;
}

eval::Table cost_table(const Plan& plan, const std::filesystem::path& out) {
  struct Sum {
    std::string step;
    double seconds = 0, memory = 0, disk = 0;
    int done = 0, jobs = 0;
  };
  std::vector<Sum> sums;
  for (const Job& job : plan.jobs) {
    auto sum = std::find_if(sums.begin(), sums.end(), [&](const Sum& s) { return s.step == job.step; });
    if (sum == sums.end()) sum = sums.insert(sums.end(), {job.step, 0, 0, 0, 0, 0});
    ++sum->jobs;
    const auto record = read_record(out, job.id);
    if (!record || record->state != JobRecord::State::kDone) continue;
    ++sum->done;
    sum->seconds += record->seconds;
    sum->disk += static_cast<double>(record->disk_bytes);
    sum->memory = std::max(sum->memory, static_cast<double>(record->peak_bytes));
  }
  eval::Table table;
  table.columns = {"step", "jobs", "done", "time of one", "peak memory", "disk of one"};
  for (const Sum& sum : sums) {
    const double n = std::max(1, sum.done);
    table.rows.push_back({sum.step, std::to_string(sum.jobs), std::to_string(sum.done), duration_text(sum.seconds / n),
                          size_text(sum.memory), size_text(sum.disk / n)});
  }
  return table;
}

}  // namespace anigen::experiment
