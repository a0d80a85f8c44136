#include "anigen/eval/inputs/pairs.h"

#include <algorithm>
#include <map>
#include <set>

namespace anigen::eval {
namespace {

std::string listed(const std::set<std::string>& ids) {
  std::string text;
  std::size_t told = 0;
  for (const std::string& id : ids) {
    if (++told > 3) return text + " and " + std::to_string(ids.size() - 3) + " more";
    text += (text.empty() ? "" : ", ") + id;
  }
  return text;
}

using Index = std::map<std::string, std::set<std::string>>;  // name → ids

Index index_by_name(const io::ShapeSource& source, const std::vector<std::string>& ids) {
  Index index;
  for (const std::string& id : ids) {
    for (const std::string& name : short_names(source, id)) index[name].insert(id);
  }
  return index;
}

/// All ids that share a name with this one.
std::set<std::string> candidates(const Index& index, const std::set<std::string>& names) {
  std::set<std::string> found;
  for (const std::string& name : names) {
    const auto there = index.find(name);
    if (there != index.end()) found.insert(there->second.begin(), there->second.end());
  }
  return found;
}

/// The second round: pairs by name among what ids left over.
void match_by_name(const io::ShapeSource& truth, const io::ShapeSource& prediction,
                   const std::vector<std::string>& open_predictions, std::vector<PairPlan*>& open_truths) {
  std::vector<std::string> truth_ids;
  for (const PairPlan* plan : open_truths) truth_ids.push_back(plan->truth_id);
  const Index predictions = index_by_name(prediction, open_predictions), truths = index_by_name(truth, truth_ids);
  for (PairPlan* plan : open_truths) {
    const std::set<std::string> found = candidates(predictions, short_names(truth, plan->truth_id));
    if (found.empty()) {
      plan->missing_reason = "no prediction in " + prediction.describe();
    } else if (found.size() > 1) {
      plan->missing_reason = "several predictions could be meant: " + listed(found);
    } else {
      const std::set<std::string> rivals = candidates(truths, short_names(prediction, *found.begin()));
      if (rivals.size() > 1)
        plan->missing_reason = "the prediction " + *found.begin() + " could be meant for several: " + listed(rivals);
      else
        plan->prediction_id = *found.begin();
    }
  }
}

}  // namespace

PairList match_pairs(const io::ShapeSource& truth, const io::ShapeSource& prediction,
                     const std::vector<std::string>& truth_ids) {
  const std::vector<std::string> predictions = prediction.ids();
  const std::set<std::string> known(predictions.begin(), predictions.end());
  PairList list;
  for (const std::string& id : truth_ids) list.pairs.push_back({id, id, std::nullopt, ""});
  std::vector<PairPlan*> open;
  std::set<std::string> used;
  for (PairPlan& plan : list.pairs) {
    if (known.count(plan.truth_id) > 0) {
      plan.prediction_id = plan.truth_id;
      used.insert(plan.truth_id);
    } else {
      open.push_back(&plan);
    }
  }
  const bool single = truth.is_single_file() && prediction.is_single_file();
  if (single && open.size() == 1 && predictions.size() == 1) {
    open.front()->prediction_id = predictions.front();
  } else {
    std::vector<std::string> left;
    std::copy_if(predictions.begin(), predictions.end(), std::back_inserter(left),
                 [&used](const std::string& id) { return used.count(id) == 0; });
    match_by_name(truth, prediction, left, open);
  }
  for (const PairPlan& plan : list.pairs) {
    if (plan.prediction_id) used.insert(*plan.prediction_id);
  }
  std::copy_if(predictions.begin(), predictions.end(), std::back_inserter(list.unused),
               [&used](const std::string& id) { return used.count(id) == 0; });
  return list;
}

}  // namespace anigen::eval
