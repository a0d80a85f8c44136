#include "anigen/train/metrics_log.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/json.h"

namespace anigen::train {
namespace {

namespace fs = std::filesystem;

std::string number_text(double value) {
  if (std::isnan(value)) return "nan";
  if (std::isinf(value)) return value > 0 ? "inf" : "-inf";
  return Json(value).dump();
}

std::string csv_line(const std::vector<std::string>& cells) {
  std::string line;
  for (const std::string& cell : cells) line += (&cell == &cells.front() ? "" : ",") + csv_field(cell);
  return line + "\n";
}

// Without a last line that a crash cut short.
CsvTable read_table(const fs::path& file) {
  CsvTable table;
  table.columns = {"step"};
  std::error_code error;
  if (!fs::exists(file, error)) return table;
  std::string text = read_file(file);
  text.erase(text.rfind('\n') == std::string::npos ? 0 : text.rfind('\n') + 1);
  if (!text.empty()) table = parse_csv(text, file.string());
  if (table.columns.empty() || table.columns[0] != "step") {
    throw InputError(file.string(), "line 1", "is no metrics table: the first column must be 'step'");
  }
  return table;
}

void drop_rows(CsvTable& table, std::int64_t step, bool after) {
  auto& rows = table.rows;
  rows.erase(std::remove_if(rows.begin(), rows.end(),
                            [&](const auto& row) { return (std::atoll(row[0].c_str()) > step) == after; }),
             rows.end());
}

}  // namespace

CsvTable metrics_after(const fs::path& file, std::int64_t step) {
  CsvTable table = read_table(file);
  drop_rows(table, step, /*after=*/false);
  return table;
}

MetricsLog::MetricsLog(fs::path file, std::int64_t last_step) : file_(std::move(file)), table_(read_table(file_)) {
  drop_rows(table_, last_step, /*after=*/true);
  rewrite();
}

void MetricsLog::rewrite() const { write_file_atomically(file_, to_csv(table_)); }

void MetricsLog::append(std::int64_t step, const Values& values) {
  const std::size_t columns_before = table_.columns.size();
  std::vector<std::string> row(columns_before);
  row[0] = std::to_string(step);
  for (const auto& [name, value] : values) {
    std::size_t column = table_.column(name);
    if (column == CsvTable::kMissing) {
      column = table_.columns.size();
      table_.columns.push_back(name);
      row.emplace_back();
    }
    row[column] = number_text(value);
  }
  table_.rows.push_back(row);
  if (table_.columns.size() != columns_before) {
    for (auto& each : table_.rows) each.resize(table_.columns.size());
    rewrite();
    return;
  }
  std::ofstream out(file_, std::ios::app | std::ios::binary);
  out << csv_line(row) << std::flush;
  if (!out) throw Error(file_.string() + ": cannot write");
}

void RunningMeans::add_sum(const Entry& other) {
  auto found =
      std::find_if(entries_.begin(), entries_.end(), [&](const Entry& entry) { return entry.name == other.name; });
  if (found == entries_.end()) found = entries_.insert(entries_.end(), Entry{other.name});
  if (!std::isfinite(other.sum)) return;
  found->sum += other.sum;
  found->count += other.count;
}

Values RunningMeans::means() const {
  Values values;
  for (const Entry& entry : entries_) {
    values.emplace_back(entry.name, entry.count > 0 ? entry.sum / static_cast<double>(entry.count) : std::nan(""));
  }
  return values;
}

}  // namespace anigen::train
