#include "anigen/eval/inputs/pairs.h"

#include <algorithm>
#include <map>
#include <set>

#include "anigen/core/error.h"
#include "anigen/io/rigs/split.h"

namespace anigen::eval {
namespace {

/// The names of a prediction; least of all counts the folder that it lies in, "<uuid>/skinned.fbx".
io::NameForms prediction_forms(const io::ShapeSource& source, const std::string& id) {
  io::NameForms forms = io::name_forms(source, id);
  const std::string folder = std::filesystem::path(id).parent_path().filename().string();
  if (!folder.empty()) forms.emplace(folder, 0);
  return forms;
}

bool ends_in_sha256(const std::string& id) {
  const io::NameForms forms = io::name_forms(id);
  return std::any_of(forms.begin(), forms.end(), [](const auto& form) { return io::is_sha256(form.first); });
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
                       "several predictions could be meant for " + plan.truth_id + ": " + io::listed(found) + kRemedy);
    const std::string& prediction = *found.begin();
    const std::set<std::string> rivals = truths_.find(prediction_forms(prediction_, prediction));
    if (rivals.size() > 1) refuse_prediction(prediction, rivals);
    if (*rivals.begin() == plan.truth_id) settle(plan, prediction);
  }

  [[noreturn]] void refuse_prediction(const std::string& id, const std::set<std::string>& truths) const {
    throw InputError(truth_.describe(), "",
                     "the prediction " + id + " could be meant for several: " + io::listed(truths) + kRemedy);
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
                           io::listed({*plan.prediction_id, prediction}) + kRemedy);
    settle(plan, prediction);
  }

  const io::ShapeSource& truth_;
  const io::ShapeSource& prediction_;
  std::map<std::string, std::string> paired_;
  io::NameIndex predictions_, truths_;
};

}  // namespace

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

}  // namespace anigen::eval
