#include "anigen/eval/skin_intervals.h"

#include <limits>
#include <map>
#include <string>
#include <vector>

namespace anigen::eval {

namespace {

constexpr std::array<const char*, SkeletonMeans::kScores> kIntervalScores = {"skin_l1", "skin_kl", "deformation"};

using SkeletonScores = std::array<std::vector<double>, SkeletonMeans::kScores>;

/// Mean of every skeleton, in the order of their signatures, over the rigs that neither the method nor `beside` failed
/// on; NaN where there is none.
SkeletonScores skeleton_scores(const SkinEvaluation& evaluation, std::size_t method, std::size_t beside) {
  struct Sums {
    std::array<double, SkeletonMeans::kScores> sum{};
    double rigs = 0.0;
  };
  std::map<std::string, Sums> skeletons;
  for (const AssetResult& asset : evaluation.assets) {
    Sums& sums = skeletons[asset.skeleton];
    const MethodResult& result = asset.methods[method];
    if (!result.failure.empty() || !asset.methods[beside].failure.empty()) continue;
    const double scores[] = {result.scores.mean.l1, result.scores.mean.kl, result.deformation};
    for (std::size_t k = 0; k < SkeletonMeans::kScores; ++k) sums.sum[k] += scores[k];
    sums.rigs += 1.0;
  }
  SkeletonScores means;
  for (const auto& [signature, sums] : skeletons) {
    for (std::size_t k = 0; k < SkeletonMeans::kScores; ++k)
      means[k].push_back(sums.rigs > 0.0 ? sums.sum[k] / sums.rigs : std::numeric_limits<double>::quiet_NaN());
  }
  return means;
}

std::string with_half_interval(double mean, const Interval& interval) {
  return anigen::fixed(mean) + " ± " + anigen::fixed(0.5 * (interval.high - interval.low));
}

}  // namespace

SkeletonMeans over_skeletons(const SkinEvaluation& evaluation, std::size_t method) {
  constexpr const char* kPurpose = "skeletons";
  SkeletonMeans result;
  for (const AssetResult& asset : evaluation.assets) result.assets += asset.methods[method].failure.empty() ? 1 : 0;
  const SkeletonScores own = skeleton_scores(evaluation, method, method);
  // Differences are of the same rigs: a method that fails on the hard ones of a skeleton would win.
  const SkeletonScores paired = skeleton_scores(evaluation, method, 0), first = skeleton_scores(evaluation, 0, method);
  for (std::size_t k = 0; k < SkeletonMeans::kScores; ++k) {
    std::vector<double> values;
    for (const double value : own[k]) {
      if (value == value) values.push_back(value);
    }
    result.skeletons = values.size();
    if (values.empty()) return result;
    result.mean[k] = 0.0;
    for (const double value : values) result.mean[k] += value / static_cast<double>(values.size());
    result.interval[k] = bootstrap_mean(values, 0, kPurpose);
    if (method > 0) result.to_first[k] = paired_difference(paired[k], first[k], 0, kPurpose);
  }
  return result;
}

anigen::Table skeleton_table(const SkinEvaluation& evaluation) {
  anigen::Table table{{"method", "l1", "KL", "deformation error", "l1 less the first one's", "skeletons", "rigs"}, {}};
  for (std::size_t m = 0; m < evaluation.methods.size(); ++m) {
    const SkeletonMeans means = over_skeletons(evaluation, m);
    std::vector<std::string> row = {evaluation.methods[m].label};
    for (std::size_t k = 0; k < SkeletonMeans::kScores; ++k)
      row.push_back(means.skeletons > 0 ? with_half_interval(means.mean[k], means.interval[k]) : "–");
    const PairedDifference& paired = means.to_first[0];
    row.push_back(m > 0 && paired.n > 0 ? with_half_interval(paired.mean, paired.interval) : "–");
    row.push_back(std::to_string(means.skeletons));
    row.push_back(std::to_string(means.assets));
    table.rows.push_back(std::move(row));
  }
  return table;
}

Json to_json(const SkeletonMeans& means) {
  Json json = {{"skeletons", means.skeletons}, {"assets", means.assets}};
  for (std::size_t k = 0; k < SkeletonMeans::kScores && means.skeletons > 0; ++k) {
    json[kIntervalScores[k]] = {{"mean", means.mean[k]}, {"interval", {means.interval[k].low, means.interval[k].high}}};
  }
  return json;
}

}  // namespace anigen::eval
