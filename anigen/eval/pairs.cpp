#include "anigen/eval/pairs.h"

#include <algorithm>
#include <cstdint>
#include <map>
#include <set>
#include <utility>

#include "anigen/asset/skeleton.h"
#include "anigen/core/error.h"
#include "anigen/core/text.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/metrics/skin_metrics.h"

namespace anigen::eval {

namespace {

/// The names of a prediction; least of all counts the folder that it lies in, "<uuid>/skinned.fbx".
io::NameForms prediction_forms(const io::ShapeSource& source, const std::string& id) {
  io::NameForms forms = io::name_forms(source, id);
  const std::string folder = std::filesystem::path(id).parent_path().filename().string();
  if (!folder.empty()) forms.emplace(folder, 0);
  return forms;
}

constexpr const char* kRemedy = "; keep one of them, or name the pairs in a CSV (--pred pairs.csv)";

/// The second round: pairs by name what ids left over.
class PairsByName {
 public:
  /// @param paired prediction → truth of equal id
  PairsByName(const io::ShapeSource& truth, const io::ShapeSource& prediction,
              std::map<std::string, std::string> paired)
      : truth_(truth), prediction_(prediction), paired_(std::move(paired)) {
    for (const std::string& id : prediction.ids()) predictions_.add(id, prediction_forms(prediction, id));
    for (const std::string& id : truth.ids()) truths_.add(id, io::name_forms(truth, id));
  }

  void pair(const std::vector<PairPlan*>& plans) {
    std::vector<std::string> open;
    for (const PairPlan* plan : plans) open.push_back(plan->truth_id);
    const std::vector<std::string> predictions = prediction_.ids();
    const bool hashed = std::any_of(predictions.begin(), predictions.end(), [this](const std::string& id) {
      return paired_.count(id) == 0 && ends_in_sha256(id);
    });
    // Whose content has which sha256 costs reading every truth.
    io::NameIndex contents;
    if (hashed) io::add_content_ids(truth_, open, contents);
    for (PairPlan* plan : plans) pair(*plan);
    if (!hashed) return;
    std::map<std::string, PairPlan*> by_id;
    for (PairPlan* plan : plans) by_id[plan->truth_id] = plan;
    for (const std::string& id : predictions) {
      if (paired_.count(id) > 0) continue;
      const std::set<std::string> found = contents.find(io::name_forms(id));
      if (found.size() > 1) refuse_prediction(id, found);
      if (found.size() == 1) settle_by_content(*by_id.at(*found.begin()), id);
    }
  }

 private:
  void pair(PairPlan& plan) {
    const std::set<std::string> found = predictions_.find(io::name_forms(truth_, plan.truth_id));
    plan.missing_reason = "no prediction in " + prediction_.describe();
    if (found.empty()) return;
    const auto taken = std::find_if(found.begin(), found.end(), [this, &plan](const std::string& id) {
      const auto there = paired_.find(id);
      return there != paired_.end() && there->second != plan.truth_id;
    });
    if (taken != found.end()) {
      plan.missing_reason += ": " + *taken + " has its name, and is that of " + paired_.at(*taken);
      return;
    }
    if (found.size() > 1)
      throw InputError(prediction_.describe(), "",
                       "several predictions could be meant for " + plan.truth_id + ": " + listed(found) + kRemedy);
    const std::string& prediction = *found.begin();
    const std::set<std::string> rivals = truths_.find(prediction_forms(prediction_, prediction));
    if (rivals.size() > 1) refuse_prediction(prediction, rivals);
    if (*rivals.begin() == plan.truth_id) settle(plan, prediction);
  }

  [[noreturn]] void refuse_prediction(const std::string& id, const std::set<std::string>& truths) const {
    throw InputError(truth_.describe(), "",
                     "the prediction " + id + " could be meant for several: " + listed(truths) + kRemedy);
  }

  void settle(PairPlan& plan, const std::string& prediction) {
    plan.prediction_id = prediction;
    plan.missing_reason.clear();
    paired_.emplace(prediction, plan.truth_id);
  }

  void settle_by_content(PairPlan& plan, const std::string& prediction) {
    if (plan.prediction_id)
      throw InputError(prediction_.describe(), "",
                       "several predictions could be meant for " + plan.truth_id + ": " +
                           listed({*plan.prediction_id, prediction}) + kRemedy);
    settle(plan, prediction);
  }

  const io::ShapeSource& truth_;
  const io::ShapeSource& prediction_;
  std::map<std::string, std::string> paired_;
  io::NameIndex predictions_, truths_;
};

}  // namespace

namespace fs = std::filesystem;

bool ends_in_sha256(const std::string& id) {
  const io::NameForms forms = io::name_forms(id);
  return std::any_of(forms.begin(), forms.end(), [](const auto& form) { return io::is_sha256(form.first); });
}

PairList match_pairs(const io::ShapeSource& truth, const io::ShapeSource& prediction,
                     const std::vector<std::string>& truth_ids) {
  const std::vector<std::string> predictions = prediction.ids();
  const std::set<std::string> known(predictions.begin(), predictions.end());
  PairList list;
  for (const std::string& id : truth_ids) list.pairs.push_back({id, id, std::nullopt, ""});
  std::vector<PairPlan*> open;
  for (PairPlan& plan : list.pairs) {
    if (known.count(plan.truth_id) > 0)
      plan.prediction_id = plan.truth_id;
    else
      open.push_back(&plan);
  }
  const bool single = truth.is_single_file() && prediction.is_single_file();
  if (single && open.size() == 1 && predictions.size() == 1) {
    open.front()->prediction_id = predictions.front();
  } else if (!open.empty()) {
    std::map<std::string, std::string> paired;
    for (const std::string& id : truth.ids()) {
      if (known.count(id) > 0) paired.emplace(id, id);
    }
    PairsByName(truth, prediction, std::move(paired)).pair(open);
  }
  std::set<std::string> used;
  for (const PairPlan& plan : list.pairs) {
    if (plan.prediction_id) used.insert(*plan.prediction_id);
  }
  std::copy_if(predictions.begin(), predictions.end(), std::back_inserter(list.unused),
               [&used](const std::string& id) { return used.count(id) == 0; });
  return list;
}

std::vector<io::DatasetItem> select_split(const std::vector<io::DatasetItem>& items,
                                          const std::vector<fs::path>& splits) {
  io::NameIndex index;
  std::set<std::string> known, wanted;
  for (const io::DatasetItem& item : items) {
    known.insert(item.id);
    index.add(item.id, item.other_names);
  }
  for (const fs::path& split : splits) {
    for (const io::SplitLine& line : io::split_lines(split)) {
      const std::string place = "line " + std::to_string(line.line);
      const std::string id = known.count(line.id) > 0 ? line.id : index.find_one(line.id, split.string(), place);
      if (id.empty()) throw InputError(split.string(), place, "the dataset has no asset called \"" + line.id + "\"");
      wanted.insert(id);
    }
  }
  std::vector<io::DatasetItem> selected;
  for (const io::DatasetItem& item : items) {
    if (wanted.count(item.id) > 0) selected.push_back(item);
  }
  return selected;
}

GroundTruth read_ground_truth(const fs::path& root, const std::string& id) {
  const fs::path file = root / "skeleton" / id / "skeleton_voxelized.npz";
  const io::NamedArrays arrays = io::read_npz(file, {"joints", "parents", "skin", "vertices", "faces"});
  const io::ArrayFields fields(arrays, file.string());
  GroundTruth truth;
  fields.array("joints", {-1, 3});
  truth.joints = fields.points("joints");
  fields.array("vertices", {-1, 3});
  truth.vertices = fields.points("vertices");
  const auto joints = static_cast<std::int64_t>(truth.joints.size());
  const auto vertices = static_cast<std::int64_t>(truth.vertices.size());
  if (vertices == 0) fields.fail("vertices", "there is not one vertex");
  truth.parents = fields.integers("parents", {joints});
  check(JointTree{fields.points<Eigen::Vector3d>("joints"), truth.parents}, file.string());
  truth.skin = fields.reals("skin", {vertices, joints});
  const std::size_t columns = truth.joints.size();
  for (std::size_t v = 0; v < truth.vertices.size(); ++v) {
    float* row = truth.skin.data() + v * columns;
    if (std::any_of(row, row + columns, [](float w) { return w != 0.0f; })) continue;
    row[0] = 1.0f;
    ++truth.unweighted;
  }
  metrics::normalize_rows(truth.skin, truth.vertices.size(), columns, file.string());
  truth.faces = fields.triangles("faces", truth.vertices.size());
  return truth;
}

Asset to_asset(const GroundTruth& truth, const std::vector<float>& skin) {
  Asset asset;
  asset.mesh.vertices = truth.vertices;
  asset.mesh.faces = truth.faces;
  asset.skeleton = skeleton_from_joints(in_double(truth.joints), truth.parents);
  asset.skin = from_dense(skin, truth.vertex_count(), truth.joint_count());
  return asset;
}

}  // namespace anigen::eval
