#include "anigen/eval/skeleton/connectivity.h"

#include <string>

#include "anigen/core/error.h"

namespace anigen::eval {
namespace {

std::size_t bone_count(const io::JointTree& tree) { return tree.size() - roots(tree).size(); }

double share(std::size_t right, std::size_t bones, std::size_t other_bones) {
  if (bones == 0) return other_bones == 0 ? 1.0 : 0.0;
  return static_cast<double>(right) / static_cast<double>(bones);
}

}  // namespace

ConnectivityScore connectivity(const io::JointTree& predicted, const io::JointTree& truth,
                               const std::vector<int>& truth_of) {
  check(predicted, "");
  check(truth, "");
  if (truth_of.size() != predicted.size()) {
    throw InputError(
        "", "joint matching",
        std::to_string(truth_of.size()) + " matches for " + std::to_string(predicted.size()) + " predicted joints");
  }
  for (const int k : truth_of) {
    if (k < -1 || k >= static_cast<int>(truth.size()))
      throw InputError("", "joint matching", "match " + std::to_string(k) + " is not a true joint");
  }
  ConnectivityScore score;
  score.predicted_bones = bone_count(predicted);
  score.true_bones = bone_count(truth);
  for (std::size_t j = 0; j < predicted.size(); ++j) {
    if (predicted.parents[j] < 0) continue;
    const int a = truth_of[j], b = truth_of[static_cast<std::size_t>(predicted.parents[j])];
    if (a < 0 || b < 0) continue;
    score.right += truth.parents[static_cast<std::size_t>(a)] == b || truth.parents[static_cast<std::size_t>(b)] == a;
  }
  score.precision = share(score.right, score.predicted_bones, score.true_bones);
  score.recall = share(score.right, score.true_bones, score.predicted_bones);
  return score;
}

std::size_t joint_count_error(const io::JointTree& predicted, const io::JointTree& truth) {
  return predicted.size() > truth.size() ? predicted.size() - truth.size() : truth.size() - predicted.size();
}

}  // namespace anigen::eval
