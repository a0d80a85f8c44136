#include <set>
#include <utility>

#include "anigen/core/csv.h"
#include "anigen/core/error.h"
#include "anigen/eval/inputs/pairs.h"
#include "anigen/io/rigs/file_list.h"

namespace anigen::eval {
namespace {

namespace fs = std::filesystem;

/// Opens each listed file when it is its turn: a damaged one is one failed row.
io::FileListSource::Reader read_one(const io::SourceOptions& options) {
  return [options](const fs::path& file, const std::string& id) {
    const std::unique_ptr<io::ShapeSource> source = io::open_source(file, options);
    const std::vector<std::string> ids = source->ids();
    if (ids.size() != 1)
      throw InputError(file.string(), "", "holds " + std::to_string(ids.size()) + " shapes, a pair needs one");
    io::RiggedShape shape = source->read(ids.front());
    shape.id = id;
    return shape;
  };
}

}  // namespace

PairedSources read_pairs_csv(const fs::path& csv, const io::SourceOptions& truth_options,
                             const io::SourceOptions& prediction_options) {
  const CsvTable table = read_csv(csv);
  for (const char* column : {"pred", "gt"}) {
    if (table.column(column) == CsvTable::kMissing)
      throw InputError(csv.string(), "line 1", std::string("no column \"") + column + "\": the header is pred,gt[,id]");
  }
  if (table.rows.empty()) throw InputError(csv.string(), "", "lists no pair");
  const fs::path folder = csv.parent_path();
  std::vector<io::FileListSource::Entry> truths, predictions;
  std::set<std::string> seen;
  PairedSources sources;
  for (std::size_t row = 0; row < table.rows.size(); ++row) {
    const std::string place = "row " + std::to_string(row + 1);
    const std::string& gt = table.cell(row, "gt");
    const std::string& pred = table.cell(row, "pred");
    if (gt.empty()) throw InputError(csv.string(), place, "names no gt");
    const std::string& told = table.cell(row, "id");
    PairPlan plan;
    plan.id = plan.truth_id = told.empty() ? fs::path(gt).stem().string() : told;
    if (!seen.insert(plan.id).second)
      throw InputError(csv.string(), place, "the id " + plan.id + " appears twice; give each row one in a column id");
    truths.push_back({plan.id, folder / gt});
    std::error_code error;
    if (pred.empty()) {
      plan.missing_reason = "the CSV names no prediction";
    } else if (!fs::exists(folder / pred, error)) {
      plan.missing_reason = "no prediction: " + (folder / pred).string() + " is missing";
    } else {
      plan.prediction_id = plan.id;
      predictions.push_back({plan.id, folder / pred});
    }
    sources.list.pairs.push_back(std::move(plan));
  }
  const std::string count = std::to_string(table.rows.size()) + " pairs of " + csv.string();
  sources.truth =
      std::make_unique<io::FileListSource>(std::move(truths), read_one(truth_options), count + ", gt", false);
  sources.prediction = std::make_unique<io::FileListSource>(std::move(predictions), read_one(prediction_options),
                                                            count + ", pred", false);
  return sources;
}

}  // namespace anigen::eval
