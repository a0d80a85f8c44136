#pragma once
#include <filesystem>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/table.h"
#include "anigen/eval/comparison.h"
#include "anigen/experiment/plan.h"
#include "anigen/experiment/results.h"

namespace anigen::experiment {

/// Outcome of a claim.
enum class Verdict {
  kConfirmed,  ///< every 95 % interval of the advantage lies above the margin
  kRefuted,    ///< every one lies below
  kTooSmall,   ///< an interval holds the margin, p is .05 or more, or there is one seed of what seeds change
  kNotRun
};

/// "confirmed", "refuted", "too small to tell", "not run".
const char* word_of(Verdict verdict);

/// A claim and the numbers that speak for or against it. The advantage of `of` over `over` is positive where it is
/// better.
struct ClaimResult {
  ClaimSpec spec;
  Cell of, over;
  std::pair<double, double> here;   ///< means of both on what both have (paired()), or costs
  std::size_t assets = 0;           ///< that either has; by_asset.n of them count
  eval::PairedDifference by_asset;  ///< of means over seeds, paired by asset and seed; 95 % by bootstrap
  double p = std::numeric_limits<double>::quiet_NaN();  ///< of by_asset against the margin, by sign_flip_p()
  std::vector<double> by_seed;   ///< advantage of the means over assets, per seed; one without several seeds
  eval::Interval seed_interval;  ///< 95 % by Student's t; without width for one seed, which then decides nothing
  Verdict verdict = Verdict::kNotRun;
  std::string reason;  ///< of a verdict that could not be given
};

/// Every claim of an experiment, from what is done so far. Failures of a method leave an asset out of the comparison,
/// as they do in tables. @throws InputError as collect_results()
std::vector<ClaimResult> judge_claims(const Experiment& experiment, const Plan& plan, const std::filesystem::path& out);

/// Verdict of intervals against the margin.
/// @param p of the assets' differences from the margin; from .05 on, and NaN, nothing is decided
/// @param seeds how many the second interval is over
Verdict verdict_of(const eval::PairedDifference& by_asset, double p, const eval::Interval& over_seeds,
                   std::size_t seeds, double margin);

/// Claim, source, published and own numbers, advantage over assets and over seeds, verdict.
Table claim_table(const std::vector<ClaimResult>& claims);

/// The sentence that explains claim_table().
std::string claim_text();

Json claims_json(const std::vector<ClaimResult>& claims);

}  // namespace anigen::experiment
