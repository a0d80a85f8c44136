#include "anigen/eval/pairs_csv.h"

#include <set>
#include <unordered_map>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/table.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/rigs/samples.h"

namespace anigen::eval {

namespace {

namespace fs = std::filesystem;

/// One side of the rows. Opens each file when it is its turn: a damaged one is a failed row.
class SideOfPairs : public io::ShapeSource {
 public:
  SideOfPairs(const io::SourceOptions& options, std::string description)
      : options_(options), shards_(options), description_(std::move(description)) {}

  void add(const std::string& id, const fs::path& cell) {
    ids_.push_back(id);
    const auto sample = io::sample_of(cell);
    places_.emplace(id, sample ? *sample : std::pair{cell, std::string()});
  }

  std::vector<std::string> ids() const override { return ids_; }
  io::RiggedShape read(const std::string& id) const override {
    const auto& [file, sample] = place(id);
    io::RiggedShape shape = sample.empty() ? read_only_shape(file) : shards_.read(file, sample);
    shape.id = id;
    return shape;
  }
  std::vector<fs::path> files(const std::string& id) const override { return io::files_read_with(place(id).first); }
  std::string describe() const override { return description_; }

 private:
  const std::pair<fs::path, std::string>& place(const std::string& id) const {
    const auto found = places_.find(id);
    if (found == places_.end()) throw InputError(description_, "", "there is no \"" + id + "\"");
    return found->second;
  }

  io::RiggedShape read_only_shape(const fs::path& file) const {
    io::require_content(file);
    const std::unique_ptr<io::ShapeSource> source = io::open_source(file, options_);
    const std::vector<std::string> ids = source->ids();
    if (ids.size() != 1)
      throw InputError(file.string(), "",
                       "holds " + std::to_string(ids.size()) + " shapes, a pair needs one: name it, as in " +
                           file.filename().string() + "#" + ids.front());
    return source->read(ids.front());
  }

  io::SourceOptions options_;
  io::OpenShards shards_;
  std::string description_;
  std::vector<std::string> ids_;
  std::unordered_map<std::string, std::pair<fs::path, std::string>> places_;  ///< file and sample
};

/// A row's name, where its CSV gives none.
std::string name_of_truth(const std::string& cell) {
  const std::string key = io::key_of_sample(cell);
  if (key.empty()) return fs::path(cell).stem().string();
  const bool number = key.find_first_not_of("0123456789") == std::string::npos;
  return number ? fs::path(cell.substr(0, cell.find('#'))).stem().string() + "#" + key : key;
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
  const std::string count = std::to_string(table.rows.size()) + " pairs of " + csv.string();
  auto truths = std::make_unique<SideOfPairs>(truth_options, count + ", gt");
  auto predictions = std::make_unique<SideOfPairs>(prediction_options, count + ", pred");
  std::set<std::string> seen;
  PairedSources sources;
  for (std::size_t row = 0; row < table.rows.size(); ++row) {
    const std::string place = "row " + std::to_string(row + 1);
    const std::string& gt = table.cell(row, "gt");
    const std::string& pred = table.cell(row, "pred");
    if (gt.empty()) throw InputError(csv.string(), place, "names no gt");
    const std::string& told = table.cell(row, "id");
    PairPlan plan;
    plan.id = plan.truth_id = told.empty() ? name_of_truth(gt) : told;
    if (!seen.insert(plan.id).second)
      throw InputError(csv.string(), place, "the id " + plan.id + " appears twice; give each row one in a column id");
    truths->add(plan.id, folder / gt);
    std::error_code error;
    if (pred.empty()) {
      plan.missing_reason = "the CSV names no prediction";
    } else if (!fs::exists(folder / pred, error) && !io::sample_of(folder / pred)) {
      plan.missing_reason = "no prediction: " + (folder / pred).string() + " is missing";
    } else {
      plan.prediction_id = plan.id;
      predictions->add(plan.id, folder / pred);
    }
    sources.list.pairs.push_back(std::move(plan));
  }
  sources.truth = std::move(truths);
  sources.prediction = std::move(predictions);
  return sources;
}

}  // namespace anigen::eval
