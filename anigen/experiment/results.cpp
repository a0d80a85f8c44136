#include "anigen/experiment/results.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <set>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/experiment/command.h"
#include "anigen/experiment/run_jobs.h"
#include "anigen/experiment/sheets.h"

namespace anigen::experiment {

namespace {

namespace fs = std::filesystem;

constexpr std::size_t kFewestForVerdict = 6, kSignDraws = 10000;

double mean_of(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

/// 97.5 % quantile of Student's t; Abramowitz and Stegun 26.7.5 beyond the tabulated degrees of freedom.
double student_quantile(std::size_t freedom) {
  constexpr double kTable[] = {12.7062, 4.3027, 3.1824, 2.7764, 2.5706, 2.4469, 2.3646, 2.3060, 2.2622, 2.2281};
  if (freedom <= std::size(kTable)) return kTable[freedom - 1];
  const double z = 1.959964;
  const double n = static_cast<double>(freedom);
  return z + (z * z * z + z) / (4 * n) + (5 * std::pow(z, 5) + 16 * z * z * z + 3 * z) / (96 * n * n);
}

/// One file of metrics, asset by asset.
struct Metrics {
  std::vector<std::string> methods;                                          ///< in the file's order
  std::map<std::string, std::vector<std::map<std::string, double>>> values;  ///< method → column → id → value
  std::map<std::string, std::size_t> assets, failed;
};

Metrics read_metrics(const fs::path& file, const std::vector<Column>& columns) {
  const CsvTable table = metrics_table(file, columns);
  Metrics metrics;
  for (std::size_t r = 0; r < table.rows.size(); ++r) {
    const std::string& method = table.cell(r, "method");
    if (metrics.values.count(method) == 0) metrics.methods.push_back(method);
    auto& values = metrics.values[method];
    values.resize(columns.size());
    ++metrics.assets[method];
    metrics.failed[method] += table.cell(r, "failure").empty() ? 0 : 1;
    for (std::size_t c = 0; c < columns.size(); ++c) {
      const double value = number_in(table.cell(r, columns[c].key));
      if (std::isfinite(value)) values[c][table.cell(r, "id")] = value;
    }
  }
  return metrics;
}

/// The file itself, or of those that a * stands for the last one, numbers counting: step1200 is after step800.
fs::path last_file(const fs::path& folder, const std::string& file) {
  if (file.find('*') == std::string::npos) return folder / file;
  std::vector<fs::path> files = matching_files(folder, file);
  if (files.empty()) throw InputError((folder / file).string(), "", "there is no such file");
  const auto is_before = [](const fs::path& a, const fs::path& b) {
    return std::make_pair(a.native().size(), a) < std::make_pair(b.native().size(), b);
  };
  return *std::max_element(files.begin(), files.end(), is_before);
}

Cell cell_of(std::vector<std::map<std::string, double>> seeds, const std::string& purpose) {
  // One run that all seeds share serves every seed of another cell.
  if (std::adjacent_find(seeds.begin(), seeds.end(), std::not_equal_to<>()) == seeds.end() && !seeds.empty())
    seeds.resize(1);
  Cell cell;
  std::map<std::string, std::vector<double>> assets;
  for (const auto& values : seeds) {
    std::vector<double> all;
    for (const auto& [id, value] : values) {
      all.push_back(value);
      assets[id].push_back(value);
    }
    if (!all.empty()) cell.by_seed.push_back(mean_of(all));
  }
  // Its interval over seeds would have no width; nor may it have one while some seeds are not there yet.
  const auto is_there = [](const auto& values) { return !values.empty(); };
  const auto first = std::find_if(seeds.begin(), seeds.end(), is_there);
  if (std::all_of(seeds.begin(), seeds.end(), [&](const auto& values) { return values.empty() || values == *first; }))
    cell.by_seed.resize(std::min<std::size_t>(cell.by_seed.size(), 1));
  cell.seed_assets = std::move(seeds);
  if (!cell.has()) return cell;
  std::vector<double> all;
  for (const auto& [id, values] : assets) all.push_back(cell.by_asset[id] = mean_of(values));
  cell.mean = mean_of(cell.by_seed);
  cell.interval =
      cell.by_seed.size() > 1 ? student_interval(cell.by_seed) : eval::bootstrap_mean(all, 0, "experiment " + purpose);
  return cell;
}

std::vector<Row> rows_of(const std::string& variant, const std::vector<Metrics>& seeds, const TableSpec& spec) {
  std::vector<std::string> methods = spec.methods;
  if (spec.methods.empty()) {
    for (const Metrics& metrics : seeds) {
      for (const std::string& method : metrics.methods)
        if (std::find(methods.begin(), methods.end(), method) == methods.end()) methods.push_back(method);
    }
  }
  std::vector<Row> rows;
  for (const std::string& method : methods) {
    Row row{variant, method, 0, 0, {}};
    std::vector<std::vector<std::map<std::string, double>>> by_column(spec.columns.size());
    for (const Metrics& metrics : seeds) {
      const auto found = metrics.values.find(method);
      if (found == metrics.values.end()) {
        for (auto& column : by_column) column.emplace_back();
        continue;
      }
      row.assets += metrics.assets.at(method);
      row.failed += metrics.failed.at(method);
      for (std::size_t c = 0; c < by_column.size(); ++c) by_column[c].push_back(found->second[c]);
    }
    for (std::size_t c = 0; c < by_column.size(); ++c)
      row.cells.push_back(cell_of(by_column[c], method + spec.columns[c].key));
    rows.push_back(std::move(row));
  }
  return rows;
}

Difference difference_of(const std::vector<Row>& rows, std::size_t row, std::size_t against, const TableSpec& spec) {
  Difference result{row, against, {}, {}};
  for (std::size_t c = 0; c < spec.columns.size(); ++c) {
    const PairedCells pairs = paired(rows[row].cells[c], rows[against].cells[c]);
    std::vector<double> differences;
    for (std::size_t i = 0; i < pairs.first.size(); ++i)
      differences.push_back(eval::difference(pairs.first[i], pairs.second[i]));
    const std::string purpose = rows[row].variant + spec.columns[c].key;
    result.columns.push_back(eval::paired_difference(pairs.first, pairs.second, 0, purpose));
    result.p.push_back(sign_flip_p(differences, purpose));
  }
  return result;
}

/// Number of seeds that two cells are compared in; 0 where they have other ones.
std::size_t common_seeds(const Cell& first, const Cell& second) {
  const std::size_t a = first.seed_assets.size(), b = second.seed_assets.size();
  return a == b || b == 1 ? a : a == 1 ? b : 0;
}

const std::map<std::string, double>& assets_in(const Cell& cell, std::size_t seed) {
  return cell.seed_assets[cell.seed_assets.size() == 1 ? 0 : seed];
}

/// True when both have values for the same assets in every seed.
bool same_assets(const Cell& first, const Cell& second) {
  const std::size_t seeds = common_seeds(first, second);
  for (std::size_t s = 0; s < seeds; ++s) {
    const auto &a = assets_in(first, s), &b = assets_in(second, s);
    if (!std::equal(a.begin(), a.end(), b.begin(), b.end(),
                    [](const auto& one, const auto& other) { return one.first == other.first; }))
      return false;
  }
  return seeds > 0;
}

/// Place of every row by mean: 1 best, 2 second, equal ones alike; 0 for the others and where nothing can be ranked, as
/// between rows with values on different assets: a method that fails on the hard ones would win.
std::vector<int> ranks(const ResultTable& result, std::size_t column) {
  const std::vector<int> none(result.rows.size(), 0);
  const Column::Better better = result.spec.columns[column].better;
  const std::vector<std::string>& references = result.spec.not_ranked;
  std::vector<double> means;
  const Cell* first = nullptr;
  std::size_t ranked = 0;
  for (const Row& row : result.rows) {
    const bool is_reference = std::find(references.begin(), references.end(), row.method) != references.end();
    const Cell& cell = row.cells[column];
    const bool has = cell.has() && !is_reference;
    means.push_back(has ? cell.mean : std::numeric_limits<double>::quiet_NaN());
    if (!has) continue;
    ++ranked;
    if (first == nullptr) first = &cell;
    if (!same_assets(*first, cell)) return none;
  }
  if (better == Column::Better::kNone || ranked < 2) return none;
  return eval::places(means, better == Column::Better::kLower);
}

std::string head(const Column& column) {
  return column.label + (column.better == Column::Better::kLower    ? " ↓"
                         : column.better == Column::Better::kHigher ? " ↑"
                                                                    : "");
}

std::string mean_text(const Cell& cell, int digits) {
  if (!cell.has()) return "–";
  return fixed(cell.mean, digits) + " ± " + fixed((cell.interval.high - cell.interval.low) / 2, digits);
}

bool named_variants(const ResultTable& result) {
  return std::any_of(result.rows.begin(), result.rows.end(), [](const Row& row) { return !row.variant.empty(); });
}

}  // namespace

PairedCells paired(const Cell& first, const Cell& second) {
  struct Sums {
    double first = 0.0, second = 0.0;
    std::size_t count = 0;
  };
  PairedCells result;
  std::map<std::string, Sums> assets;
  const std::size_t seeds = common_seeds(first, second);
  bool every_seed = seeds > 0;
  for (std::size_t s = 0; s < seeds; ++s) {
    const auto &mine = assets_in(first, s), &others = assets_in(second, s);
    std::vector<double> a, b, differences;
    for (const auto& [id, value] : mine) {
      Sums& sums = assets[id];
      const auto other = others.find(id);
      if (other == others.end()) continue;
      sums.first += value;
      sums.second += other->second;
      ++sums.count;
      a.push_back(value);
      b.push_back(other->second);
      differences.push_back(eval::difference(value, other->second));
    }
    for (const auto& entry : others) assets[entry.first];
    every_seed = every_seed && !a.empty();
    if (a.empty()) continue;
    result.by_seed.push_back(mean_of(differences));
    result.first_mean += mean_of(a);
    result.second_mean += mean_of(b);
  }
  if (!result.by_seed.empty()) {
    result.first_mean /= static_cast<double>(result.by_seed.size());
    result.second_mean /= static_cast<double>(result.by_seed.size());
  }
  if (!every_seed) result.by_seed.clear();
  result.assets = assets.size();
  for (const auto& [id, sums] : assets) {
    if (sums.count == 0) continue;
    result.first.push_back(sums.first / static_cast<double>(sums.count));
    result.second.push_back(sums.second / static_cast<double>(sums.count));
  }
  return result;
}

CsvTable metrics_table(const fs::path& file, const std::vector<Column>& columns) {
  CsvTable table = read_csv(file);
  std::vector<std::string> needed{"id", "method"};
  for (const Column& column : columns) needed.push_back(column.key);
  for (const std::string& name : needed) {
    if (table.column(name) == CsvTable::kMissing)
      throw InputError(file.string(), "line 1", "has no column '" + name + "'");
  }
  return table;
}

double number_in(const std::string& text) {
  if (text.empty()) return std::numeric_limits<double>::quiet_NaN();
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  return *end == '\0' ? value : std::numeric_limits<double>::quiet_NaN();
}

eval::Interval student_interval(const std::vector<double>& values) {
  const double mean = mean_of(values);
  if (values.size() < 2) return {mean, mean};
  double squares = 0;
  for (const double value : values) squares += (value - mean) * (value - mean);
  const double n = static_cast<double>(values.size());
  const double half = student_quantile(values.size() - 1) * std::sqrt(squares / (n - 1) / n);
  return {mean - half, mean + half};
}

double sign_flip_p(const std::vector<double>& differences, const std::string& purpose) {
  if (differences.size() < kFewestForVerdict) return std::numeric_limits<double>::quiet_NaN();
  const double seen = std::abs(std::accumulate(differences.begin(), differences.end(), 0.0));
  Rng rng(0, "sign flips " + purpose);
  std::size_t as_far = 0;
  for (std::size_t draw = 0; draw < kSignDraws; ++draw) {
    double sum = 0;
    for (const double difference : differences) sum += rng.chance(0.5) ? difference : -difference;
    as_far += std::abs(sum) >= seen * (1 - 1e-12) ? 1 : 0;
  }
  // The signs as they are count too, so that p is never 0.
  return static_cast<double>(as_far + 1) / static_cast<double>(kSignDraws + 1);
}

ResultTable collect_results(const Experiment& experiment, const Plan& plan, const fs::path& out, const TableSpec& spec,
                            const std::optional<std::string>& variant) {
  ResultTable table{spec, {}, {}, {}};
  for (std::size_t v = 0; v < experiment.variants.size(); ++v) {
    if (variant && experiment.variants[v].name != *variant) continue;
    std::vector<Metrics> seeds;
    std::set<std::size_t> seen;  // a step that no seed reaches is one job
    for (const PlannedRun& run : plan.runs) {
      if (run.variant != v || !seen.insert(run.jobs.at(spec.step)).second) continue;
      const Job& job = plan.jobs[run.jobs.at(spec.step)];
      if (is_done(out, job)) {
        seeds.push_back(read_metrics(last_file(job.folder, spec.file), spec.columns));
      } else {
        seeds.emplace_back();  // keeps its place, since seeds are compared one by one
        table.missing.push_back(job.id + (job.serves.front().empty() ? "" : " (" + job.serves.front() + ")"));
      }
    }
    for (Row& row : rows_of(experiment.variants[v].name, seeds, spec)) table.rows.push_back(std::move(row));
  }
  for (std::size_t r = 0; r < table.rows.size(); ++r) {
    const std::string &reference = experiment.variants.front().name, &method = table.rows[r].method;
    const auto same = [&](const Row& row) { return row.variant == reference && row.method == method; };
    const auto first = std::find_if(table.rows.begin(), table.rows.end(), same);
    if (first == table.rows.end() || table.rows[r].variant == reference) continue;
    const auto against = static_cast<std::size_t>(first - table.rows.begin());
    table.differences.push_back(difference_of(table.rows, r, against, spec));
  }
  return table;
}

Table mean_table(const ResultTable& result) {
  Table table;
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

Table difference_table(const ResultTable& result) {
  Table table;
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
        text = (of.mean >= 0 ? "+" : "") + fixed(of.mean, digits) + " [" + fixed(of.interval.low, digits) + ", " +
               fixed(of.interval.high, digits) + "]";
        if (std::isfinite(difference.p[c])) text += ", p " + fixed(difference.p[c], 4);
      }
      cells.push_back(text);
    }
    table.rows.push_back(std::move(cells));
  }
  return table;
}

Table cost_table(const Plan& plan, const std::filesystem::path& out) {
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
  Table table;
  table.columns = {"step", "jobs", "done", "time of one", "peak memory", "disk of one"};
  for (const Sum& sum : sums) {
    const double n = std::max(1, sum.done);
    table.rows.push_back({sum.step, std::to_string(sum.jobs), std::to_string(sum.done), duration_text(sum.seconds / n),
                          size_text(sum.memory), size_text(sum.disk / n)});
  }
  return table;
}

}  // namespace anigen::experiment
