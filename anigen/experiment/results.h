#pragma once
#include <cstddef>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "anigen/core/table.h"
#include "anigen/eval/comparison.h"
#include "anigen/experiment/plan.h"

namespace anigen::experiment {

/// One metric of one row of a table: an asset's value is its mean over the seeds.
struct Cell {
  std::vector<double> by_seed;             ///< mean over assets, per seed that has values; one where all are the same
  std::map<std::string, double> by_asset;  ///< mean over seeds
  /// Values of the assets, per seed of the plan, empty where a seed has none; one where all seeds give the same.
  std::vector<std::map<std::string, double>> seed_assets;
  double mean = 0;          ///< of by_seed
  eval::Interval interval;  ///< 95 %: over seeds by Student's t, with one seed over assets by bootstrap
  bool has() const { return !by_seed.empty(); }
};

/// Two cells on what both have: an asset counts in the seeds in which both have a value for it, so that a method which
/// fails on it in one seed is not compared with another seed of the other one.
struct PairedCells {
  std::vector<double> first, second;  ///< per asset that counts in a seed: means over these seeds
  std::vector<double> by_seed;  ///< mean of difference(first, second) per seed; empty unless each has assets that count
  double first_mean = 0, second_mean = 0;  ///< over seeds, of the means over the assets that count there
  std::size_t assets = 0;                  ///< that either has in any seed
};

/// @param first, second with as many seeds, or one that serves all
PairedCells paired(const Cell& first, const Cell& second);

struct Row {
  std::string variant, method;
  std::size_t assets = 0, failed = 0;  ///< of all seeds together
  std::vector<Cell> cells;             ///< one per column
};

/// A row against the first variant's row of the same method, on what both have (paired()).
struct Difference {
  std::size_t row = 0, against = 0;  ///< places in `rows`
  std::vector<eval::PairedDifference> columns;
  std::vector<double> p;  ///< two-sided, by exchanging signs at random (sign_flip_p); NaN with fewer than 6 assets
};

struct ResultTable {
  TableSpec spec;
  std::vector<Row> rows;
  std::vector<Difference> differences;
  std::vector<std::string> missing;  ///< what has not been run yet, in words
};

/// Collects one table from the metrics.csv files of the jobs that are done.
/// @param variant the only one to collect; null: all
/// @throws InputError for a file without the columns "id" and "method", or without a wanted one
ResultTable collect_results(const Experiment& experiment, const Plan& plan, const std::filesystem::path& out,
                            const TableSpec& spec, const std::optional<std::string>& variant = {});

/// A file of metrics. @throws InputError without the columns "id" and "method", or without one of these
CsvTable metrics_table(const std::filesystem::path& file, const std::vector<Column>& columns);

/// A cell of a CSV file; NaN where it holds no number.
double number_in(const std::string& text);

/// Mean of differences against the hypothesis that each could as well have the other sign: the share of 10,000 random
/// choices of signs whose mean is as far from zero (Fisher 1935). @return NaN for fewer than 6 differences
double sign_flip_p(const std::vector<double>& differences, const std::string& purpose);

/// 95 % interval of a mean by Student's t; one value gives an interval without width. @pre not empty
eval::Interval student_interval(const std::vector<double>& values);

/// Variant, method, assets, failures, and every column as "mean ± half of the 95 % interval"; the best of a column
/// `**bold**`, the second `_underlined_`, unless no direction is given or rows have values on different assets.
Table mean_table(const ResultTable& result);

/// Every variant against the first: difference, interval and p per column. Without rows when there is one variant.
Table difference_table(const ResultTable& result);

/// Time, memory and disk of every step, mean over its jobs (the papers' table of cost).
Table cost_table(const Plan& plan, const std::filesystem::path& out);

}  // namespace anigen::experiment
