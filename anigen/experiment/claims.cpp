#include "anigen/experiment/claims.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "anigen/core/text.h"
#include "anigen/experiment/method_costs.h"

namespace anigen::experiment {

namespace {

constexpr std::size_t kFewestAssets = 6;
constexpr double kSignificance = 0.05;
constexpr const char* kModelMethod = "model";

/// p of the differences from the margin (sign_flip_p()), which holds for few assets too, where the percentiles of the
/// bootstrap are too close.
double p_of(const std::vector<double>& first, const std::vector<double>& second, const ClaimSpec& spec) {
  std::vector<double> differences;
  for (std::size_t i = 0; i < std::min(first.size(), second.size()); ++i) {
    if (std::isfinite(first[i]) && std::isfinite(second[i]))
      differences.push_back(eval::difference(first[i], second[i]) - spec.margin);
  }
  return sign_flip_p(differences, spec.text);
}

/// A side's numbers. Without a method's name: of "model", which trainings write beside their baselines, or of the only
/// one. @param problem gets the jobs that have not been run, and methods of which none is named
Cell side_cell(const Experiment& experiment, const Plan& plan, const std::filesystem::path& out, const ClaimSide& side,
               const Column& column, std::vector<std::string>& problem) {
  TableSpec wanted;
  wanted.step = side.step;
  wanted.file = side.file;
  wanted.columns = {column};
  if (!side.key.empty()) wanted.columns.front().key = side.key;
  const ResultTable table = collect_results(experiment, plan, out, wanted, side.variant);
  const auto say = [&](const std::string& text) {
    if (std::find(problem.begin(), problem.end(), text) == problem.end()) problem.push_back(text);
  };
  for (const std::string& job : table.missing) say(job);
  const std::string wanted_method = side.method.empty() && table.rows.size() > 1 ? kModelMethod : side.method;
  std::vector<std::string> methods;
  for (const Row& row : table.rows) {
    if (wanted_method.empty() || row.method == wanted_method) return row.cells[0];
    methods.push_back(row.method);
  }
  if (side.method.empty() && !methods.empty())
    say(side_text(side) + " has the methods " + joined(methods) + ", and the claim names none");
  return {};
}

/// Differences of costs, run by run. A side with one value has it in all of them.
/// @return empty where the sides have other numbers of runs
std::vector<double> cost_advantages(const Cell& of, const Cell& over) {
  const std::size_t runs = std::max(of.by_seed.size(), over.by_seed.size());
  std::vector<double> advantages;
  for (const Cell* side : {&of, &over}) {
    if (side->by_seed.size() != runs && side->by_seed.size() != 1) return {};
  }
  for (std::size_t r = 0; r < runs; ++r) {
    const std::size_t a = of.by_seed.size() == 1 ? 0 : r, b = over.by_seed.size() == 1 ? 0 : r;
    advantages.push_back(-eval::difference(of.by_seed[a], over.by_seed[b]));
  }
  return advantages;
}

ClaimResult judged(const Experiment& experiment, const Plan& plan, const std::filesystem::path& out,
                   const ClaimSpec& spec) {
  ClaimResult result;
  result.spec = spec;
  std::vector<std::string> missing;
  result.of = side_cell(experiment, plan, out, spec.of, spec.column, missing);
  result.over = side_cell(experiment, plan, out, spec.over, spec.column, missing);
  if (!result.of.has() || !result.over.has()) {
    result.reason =
        missing.empty() ? "no numbers of " + side_text(result.of.has() ? spec.over : spec.of) : joined(missing);
    return result;
  }
  const double sign = spec.column.better == Column::Better::kHigher ? 1.0 : -1.0;
  PairedCells pairs = paired(result.of, result.over);
  for (std::vector<double>* values : {&pairs.first, &pairs.second, &pairs.by_seed}) {
    for (double& value : *values) value *= sign;
  }
  result.by_asset = eval::paired_difference(pairs.first, pairs.second, 0, spec.text);
  result.p = p_of(pairs.first, pairs.second, spec);
  result.by_seed = std::move(pairs.by_seed);
  result.here = {pairs.first_mean, pairs.second_mean};
  result.assets = pairs.assets;
  if (!missing.empty() || result.by_seed.empty()) {
    result.reason = missing.empty() ? "both sides need the same seeds, and assets in common" : joined(missing);
    return result;
  }
  result.seed_interval = student_interval(result.by_seed);
  if (experiment.seeds.size() == 1 && !experiment.seeded.empty()) {
    // Another training could say otherwise.
    result.verdict = Verdict::kTooSmall;
    result.reason = "one seed";
    return result;
  }
  result.verdict = verdict_of(result.by_asset, result.p, result.seed_interval, result.by_seed.size(), spec.margin);
  return result;
}

/// A side of a claim about costs.
struct CostSide {
  Cell cell;                ///< one value per job for seconds, else one that repeats itself
  std::set<CoreShare> ran;  ///< of times
};

/// Shares of the cores, where the jobs of both sides had several: such times cannot be compared. Else empty.
std::string unlike_shares(const CostSide& of, const CostSide& over) {
  std::set<CoreShare> shares = of.ran;
  shares.insert(over.ran.begin(), over.ran.end());
  if (shares.size() < 2 && (shares.empty() || shares.begin()->threads != CoreShare::kChanged)) return "";
  std::vector<std::string> words;
  for (const CoreShare& share : shares) words.push_back(share.text());
  return "times are of " + joined(words, "; ");
}

std::optional<CostSide> cost_side(const Experiment& experiment, const Plan& plan, const std::filesystem::path& out,
                                  const ClaimSpec& spec, const ClaimSide& side) {
  for (const CostSpec& costs : experiment.costs) {
    for (const MethodCost& cost : method_costs(plan, out, costs)) {
      if (cost.label != side.method || cost.jobs < cost.wanted || cost.jobs == 0) continue;
      if (spec.cost == "parameters" && cost.parameters < 0) return {};
      CostSide known;
      Cell& cell = known.cell;
      if (spec.cost == "seconds") {
        cell.by_seed = cost.by_job;
        known.ran = cost.ran;
      }
      if (spec.cost == "memory") cell.by_seed = {1e-9 * static_cast<double>(cost.peak_bytes)};
      if (spec.cost == "parameters") cell.by_seed = {1e-6 * static_cast<double>(cost.parameters)};
      if (spec.cost == "training") {
        for (const double seconds : cost.training_by_seed) cell.by_seed.push_back(seconds / 60.0);
        if (cell.by_seed.empty()) return {};
        known.ran = cost.training_ran;
      }
      for (const double value : cell.by_seed) cell.mean += value / static_cast<double>(cell.by_seed.size());
      return known;
    }
  }
  return {};
}

/// Numbers of parameters decide at once, and memory, which hardly changes from run to run; times need several.
ClaimResult judged_cost(const Experiment& experiment, const Plan& plan, const std::filesystem::path& out,
                        const ClaimSpec& spec) {
  ClaimResult result;
  result.spec = spec;
  const auto of = cost_side(experiment, plan, out, spec, spec.of),
             over = cost_side(experiment, plan, out, spec, spec.over);
  if (!of || !over) {
    result.reason = "no cost of " + (of ? spec.over : spec.of).method;
    return result;
  }
  result.of = of->cell;
  result.over = over->cell;
  result.here = {result.of.mean, result.over.mean};
  result.by_seed = cost_advantages(result.of, result.over);
  result.reason = result.by_seed.empty() ? "both sides need the same seeds" : unlike_shares(*of, *over);
  if (!result.reason.empty()) {
    result.by_seed.clear();
    return result;
  }
  result.seed_interval = student_interval(result.by_seed);
  const bool repeats = spec.cost == "parameters" || spec.cost == "memory";
  // Peaks change by some pages and buffers from run to run.
  constexpr double kSameMemory = 0.01;
  if (spec.cost == "memory" &&
      std::abs(result.by_seed.front() - spec.margin) <= kSameMemory * std::max(result.of.mean, result.over.mean)) {
    result.verdict = Verdict::kTooSmall;
    result.reason = "within 1 %";
  } else if (!repeats && result.by_seed.size() < 2) {
    result.verdict = Verdict::kTooSmall;
    result.reason = "one run";
  } else if (result.seed_interval.low > spec.margin) {
    result.verdict = Verdict::kConfirmed;
  } else {
    result.verdict = result.seed_interval.high < spec.margin ? Verdict::kRefuted : Verdict::kTooSmall;
  }
  return result;
}

/// "of / over", with their steps where these differ.
std::string sides_text(const ClaimSpec& spec) {
  const auto text = [&](const ClaimSide& side) {
    const std::string named = side_text(side);
    return !spec.cost.empty() || spec.of.step == spec.over.step || named == side.step ? named
                                                                                      : named + ", " + side.step;
  };
  return text(spec.of) + " / " + text(spec.over);
}

/// True where both sides have something in common to compare.
bool compares(const ClaimResult& claim) {
  return claim.of.has() && claim.over.has() && (!claim.spec.cost.empty() || claim.by_asset.n > 0);
}

std::string advantage_text(double mean, const eval::Interval& interval, int digits) {
  return (mean >= 0 ? "+" : "") + fixed(mean, digits) + " [" + fixed(interval.low, digits) + ", " +
         fixed(interval.high, digits) + "]";
}

}  // namespace

const char* word_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::kConfirmed:
      return "confirmed";
    case Verdict::kRefuted:
      return "refuted";
    case Verdict::kTooSmall:
      return "too small to tell";
    case Verdict::kNotRun:
      break;
  }
  return "not run";
}

Verdict verdict_of(const eval::PairedDifference& by_asset, double p, const eval::Interval& over_seeds,
                   std::size_t seeds, double margin) {
  if (by_asset.n < kFewestAssets || !(p < kSignificance)) return Verdict::kTooSmall;
  const bool counts_seeds = seeds > 1;
  if (by_asset.interval.low > margin && (!counts_seeds || over_seeds.low > margin)) return Verdict::kConfirmed;
  if (by_asset.interval.high < margin && (!counts_seeds || over_seeds.high < margin)) return Verdict::kRefuted;
  return Verdict::kTooSmall;
}

std::vector<ClaimResult> judge_claims(const Experiment& experiment, const Plan& plan,
                                      const std::filesystem::path& out) {
  std::vector<ClaimResult> results;
  for (const ClaimSpec& spec : experiment.claims)
    results.push_back(spec.cost.empty() ? judged(experiment, plan, out, spec)
                                        : judged_cost(experiment, plan, out, spec));
  return results;
}

Table claim_table(const std::vector<ClaimResult>& claims) {
  Table table{
      {"claim", "source", "measured by", "published", "here", "better by, over assets", "over seeds", "verdict"}, {}};
  for (const ClaimResult& claim : claims) {
    const ClaimSpec& spec = claim.spec;
    const int digits = spec.column.digits;
    std::string published = "–", here = "–", assets = "–", seeds = "–", verdict = word_of(claim.verdict);
    if (spec.published)
      published = fixed(spec.published->first, digits) + " / " + fixed(spec.published->second, digits);
    if (compares(claim)) {
      here = fixed(claim.here.first, digits) + " / " + fixed(claim.here.second, digits);
      if (spec.cost.empty())
        assets = advantage_text(claim.by_asset.mean, claim.by_asset.interval, digits) + ", " +
                 std::to_string(claim.by_asset.n) +
                 (claim.by_asset.n < claim.assets ? " of " + std::to_string(claim.assets) : "") +
                 (std::isfinite(claim.p) ? ", p " + fixed(claim.p, 4) : "");
      double sum = 0.0;
      for (const double advantage : claim.by_seed) sum += advantage;
      const auto count = claim.by_seed.size();
      if (count > 1)
        seeds = advantage_text(sum / static_cast<double>(count), claim.seed_interval, digits) + ", " +
                std::to_string(count);
      if (count == 1) seeds = "one";
    }
    if (!claim.reason.empty()) verdict += ": " + claim.reason;
    std::string measured = spec.column.label + " of " + sides_text(spec);
    if (spec.margin != 0.0) measured += ", by " + fixed(spec.margin, digits);
    table.rows.push_back({spec.text, spec.source, std::move(measured), published, here, assets, seeds, verdict});
  }
  return table;
}

std::string claim_text() {
  return "Advantage of the first over the second, positive where it is better, with 95 % intervals: over assets (means "
         "over seeds, paired, bootstrap; number of assets, and of how many where a method has no value for some, which "
         "are left out on both sides; p by exchanging signs at random) and over seeds (Student's t; number of seeds). "
         "Confirmed or refuted: both lie on one side of the margin, which is 0 where none is named, and p is below "
         "0.05; trainings of one seed say nothing.";
}

Json claims_json(const std::vector<ClaimResult>& claims) {
  Json list = Json::array();
  for (const ClaimResult& claim : claims) {
    const ClaimSpec& spec = claim.spec;
    Json json = {{"claim", spec.text},
                 {"source", spec.source},
                 {"column", spec.column.key},
                 {"of", side_text(spec.of)},
                 {"over", side_text(spec.over)},
                 {"margin", spec.margin},
                 {"verdict", word_of(claim.verdict)}};
    if (spec.published) json["published"] = {spec.published->first, spec.published->second};
    if (!claim.reason.empty()) json["reason"] = claim.reason;
    if (compares(claim)) {
      json["here"] = {claim.here.first, claim.here.second};
      if (spec.cost.empty())
        json["by_asset"] = {{"mean", claim.by_asset.mean},
                            {"low", claim.by_asset.interval.low},
                            {"high", claim.by_asset.interval.high},
                            {"n", claim.by_asset.n},
                            {"of", claim.assets},
                            {"p", std::isfinite(claim.p) ? Json(claim.p) : Json(nullptr)}};
      json["by_seed"] = claim.by_seed;
    }
    list.push_back(std::move(json));
  }
  return list;
}

}  // namespace anigen::experiment
