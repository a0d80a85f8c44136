#include <cmath>

#include "anigen/experiment/report.h"

namespace anigen::experiment {
namespace {

Json differences_of(const ResultTable& result) {
  Json all = Json::array();
  for (const Difference& difference : result.differences) {
    Json values = Json::object();
    for (std::size_t c = 0; c < difference.columns.size(); ++c) {
      const eval::PairedDifference& of = difference.columns[c];
      const double p = difference.p[c];
      values[result.spec.columns[c].key] = {{"mean", of.mean},
                                            {"low", of.interval.low},
                                            {"high", of.interval.high},
                                            {"n", of.n},
                                            {"p", std::isfinite(p) ? Json(p) : Json(nullptr)}};
    }
    all.push_back({{"variant", result.rows[difference.row].variant},
                   {"against", result.rows[difference.against].variant},
                   {"method", result.rows[difference.row].method},
                   {"values", values}});
  }
  return all;
}

}  // namespace

Json results_json(const Experiment& experiment, const std::vector<ResultTable>& results) {
  Json tables = Json::array();
  for (const ResultTable& result : results) {
    Json rows = Json::array();
    for (const Row& row : result.rows) {
      Json cells = Json::object();
      for (std::size_t c = 0; c < row.cells.size(); ++c) {
        const Cell& cell = row.cells[c];
        if (!cell.has()) continue;
        cells[result.spec.columns[c].key] = {
            {"mean", cell.mean}, {"low", cell.interval.low}, {"high", cell.interval.high}, {"by_seed", cell.by_seed}};
      }
      rows.push_back({{"variant", row.variant},
                      {"method", row.method},
                      {"assets", row.assets},
                      {"failed", row.failed},
                      {"values", cells}});
    }
    tables.push_back({{"title", result.spec.title},
                      {"rows", rows},
                      {"differences", differences_of(result)},
                      {"missing", result.missing}});
  }
  return {{"title", experiment.title}, {"seeds", experiment.seeds}, {"tables", tables}};
}

}  // namespace anigen::experiment
