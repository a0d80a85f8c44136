#pragma once
#include <string>

#include "anigen/eval/comparison/comparison.h"

namespace anigen::eval {

/// metrics.json: `settings`; `methods`, one object per label with `summary` (key → mean, median, std, n, low, high),
/// `failed` and `assets` (id, values under their keys, `not_computed`, `notes`, `details`); `differences` of every
/// method to the first one. `summary` and `assets` of the first method stand at the top level too.
Json to_json(const Comparison& comparison);

/// metrics.csv: one row per asset and method, a column per metric; a cell without value is empty, `failure` says why.
CsvTable to_csv_table(const Comparison& comparison);

/// One sentence on the transport solver when it is not the exact one; else empty.
std::string transport_text(const Comparison& comparison);

/// table.md: headline metrics, all metrics, differences, failures with their reasons, what was not computed and why.
std::string to_markdown(const Comparison& comparison);

/// table.tex: the headline metrics as a LaTeX tabular (booktabs); best in bold, second best underlined.
std::string to_latex(const Comparison& comparison);

/// Methods × metrics; best `**bold**` and second best `_underlined_` where they can be ranked.
Table method_table(const Comparison& comparison, const std::vector<const MetricInfo*>& metrics);

/// Mean, median, interval and number of every metric of one method.
Table metric_summary_table(const Comparison& comparison, std::size_t method);

/// Ground truths, pairs and what is left over on both sides, with counts and the first names; no row when the pairing
/// is not known.
Table pairing_table(const Comparison& comparison);

/// Failures and reasons for missing values, each once with the number of assets.
Table reason_table(const Comparison& comparison);

/// Difference of every further method to the first, per headline metric, with interval.
Table difference_table(const Comparison& comparison);

}  // namespace anigen::eval
