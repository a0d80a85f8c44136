#include "anigen/eval/align/icp.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/eval/align/rotation_starts.h"

namespace anigen::eval {
namespace {

// The rule in icp.h.
constexpr std::size_t kFirstSamples = 100, kFirstScoreSamples = 200, kSecondSamples = 250;
constexpr int kFirstIterations = 15, kSecondIterations = 20;
constexpr std::size_t kAfterFirst = 16, kAfterSecond = 8, kAfterThird = 4;
constexpr double kNearSecond = 1.3, kNearThird = 1.1;
// What two samplings of one surface are apart, at most, as a share of its size: no candidate below is worse than
// another.
constexpr double kSamplingNoise = 0.05;
// Two candidates this close converge to one place.
constexpr double kSameAngle = 0.03, kSameShift = 0.02;
// Radians by which a prediction may be off and still count as lying right.
constexpr double kSmallTurn = 0.2;
// Residuals this close are equal: a share of one another, and the rounding of single precision vertices as a share of
// the shape's size.
constexpr double kEqualShare = 1e-3, kEqualRounding = 2e-7;

struct Candidate {
  int start = 0;
  int earliest = 0;         ///< the lowest start that is known to lead to the same place
  double by_samples = 0.0;  ///< residual after the last stage on samples
  IcpState state;
};

class Registration {
 public:
  Registration(const AlignmentShape& source, const AlignmentShape& target, const IcpOptions& options)
      : source_(source), target_(target), options_(options) {}

  std::vector<Candidate> starts() const {
    std::vector<Eigen::Matrix3d> rotations = random_rotations(options_.rotations, options_.seed);
    if (options_.principal_axes) {
      const auto axes = principal_axis_rotations(source_.covariance(), target_.covariance());
      rotations.insert(rotations.end(), axes.begin(), axes.end());
    }
    std::vector<Candidate> candidates(1 + rotations.size());
    for (std::size_t i = 0; i < rotations.size(); ++i) {
      Candidate& candidate = candidates[i + 1];
      candidate.start = candidate.earliest = static_cast<int>(i) + 1;
      candidate.state.transform.rotation = rotations[i];
      candidate.state.transform.translation = target_.centroid() - rotations[i] * source_.centroid();
    }
    return candidates;
  }

  void run(std::vector<Candidate>& candidates, const IcpStage& stage) const {
    each(candidates, [&](Candidate& candidate) {
      const int before = candidate.state.iterations;
      candidate.state = run_stage(source_, target_, candidate.state.transform, stage);
      candidate.state.iterations += before;
    });
  }

  void score(std::vector<Candidate>& candidates, const IcpStage& stage) const {
    each(candidates, [&](Candidate& candidate) {
      candidate.state.residual = stage_residual(source_, target_, candidate.state.transform, stage);
    });
  }

  /// Best first; equal ones in the order of the starts.
  void sort(std::vector<Candidate>& candidates) const {
    std::stable_sort(candidates.begin(), candidates.end(),
                     [](const Candidate& a, const Candidate& b) { return a.state.residual < b.state.residual; });
  }

  /// From sorted candidates, the best one at every place.
  std::vector<Candidate> without_repetitions(const std::vector<Candidate>& candidates) const {
    std::vector<Candidate> places;
    for (const Candidate& candidate : candidates) {
      const auto place = std::find_if(places.begin(), places.end(), [&](const Candidate& other) {
        return same_place(candidate.state.transform, other.state.transform);
      });
      if (place == places.end())
        places.push_back(candidate);
      else
        place->earliest = std::min(place->earliest, candidate.earliest);
    }
    return places;
  }

  void merge(std::vector<Candidate>& candidates) const {
    sort(candidates);
    if (!options_.exhaustive) candidates = without_repetitions(candidates);
  }

  /// Keeps at most `count`, of those with at most `factor` times the lowest residual, and what the identity start leads
  /// to. An infinite factor is no limit, also where the lowest residual is 0.
  void prune(std::vector<Candidate>& candidates, std::size_t count, double factor) const {
    sort(candidates);
    if (options_.exhaustive) return;
    const double limit = std::isinf(factor) ? factor
                                            : std::max(factor * candidates.front().state.residual,
                                                       kSamplingNoise * target_.rms_radius());
    std::size_t kept = 0;
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      const bool good = kept < count && candidates[i].state.residual <= limit;
      if (good || candidates[i].earliest == 0) candidates[kept++] = candidates[i];
    }
    candidates.resize(kept);
  }

  IcpResult choose(std::vector<Candidate>& candidates) const {
    sort(candidates);
    candidates = without_repetitions(candidates);
    const double lowest = candidates.front().state.residual;
    const double equal = lowest * (1.0 + kEqualShare) + kEqualRounding * target_.rms_radius();
    const Candidate* winner = &candidates.front();
    for (const Candidate& candidate : candidates) {
      if (candidate.state.residual > equal || lay_right(*winner)) continue;
      if (lay_right(candidate) || candidate.by_samples < winner->by_samples) winner = &candidate;
    }
    IcpResult result;
    result.transform = winner->state.transform;
    result.rmse = winner->state.residual;
    result.start = winner->start;
    result.iterations = winner->state.iterations;
    result.runner_up = std::numeric_limits<double>::infinity();
    for (const Candidate& candidate : candidates) {
      if (&candidate != winner) result.runner_up = std::min(result.runner_up, candidate.state.residual);
    }
    return result;
  }

  IcpStage stage(IcpStage::Target target, std::size_t samples, int iterations, double tolerance) const {
    IcpStage result;
    result.target = target;
    result.samples = samples;
    result.max_iterations = iterations;
    result.tolerance = tolerance;
    result.similarity = options_.similarity;
    result.trim = options_.trim;
    return result;
  }

 private:
  bool lay_right(const Candidate& candidate) const {
    return candidate.earliest == 0 &&
           rotation_angle(candidate.state.transform.rotation, Eigen::Matrix3d::Identity()) < kSmallTurn;
  }

  bool same_place(const Similarity& a, const Similarity& b) const {
    return rotation_angle(a.rotation, b.rotation) < kSameAngle &&
           (a(source_.centroid()) - b(source_.centroid())).norm() < kSameShift * target_.rms_radius() &&
           std::abs(std::log(a.scale / b.scale)) < kSameShift;
  }

  template <typename Body>
  void each(std::vector<Candidate>& candidates, const Body& body) const {
    if (options_.parallel) {
      parallel_for(candidates.size(), [&](std::size_t i) { body(candidates[i]); });
    } else {
      for (Candidate& candidate : candidates) body(candidate);
    }
  }

  const AlignmentShape& source_;
  const AlignmentShape& target_;
  const IcpOptions& options_;
};

}  // namespace

void check(const IcpOptions& options) {
  const auto require = [](bool ok, const char* option, const char* range) {
    if (!ok) throw InputError("", option, range);
  };
  require(options.rotations >= 0 && options.rotations <= 100000, "rotations", "must be between 0 and 100000");
  require(options.samples >= 1 && options.samples <= 10000000, "samples", "must be between 1 and 10000000");
  require(options.score_samples >= 1 && options.score_samples <= 10000000, "score_samples",
          "must be between 1 and 10000000");
  require(options.max_iterations >= 0 && options.max_iterations <= 100000, "max_iterations",
          "must be between 0 and 100000");
  require(options.trim > 0.0 && options.trim <= 1.0, "trim", "must be in (0, 1]");
}

IcpResult register_shapes(const AlignmentShape& source, const AlignmentShape& target, const IcpOptions& options) {
  check(options);
  using Target = IcpStage::Target;
  const Registration registration(source, target, options);
  std::vector<Candidate> candidates = registration.starts();
  const auto starts = static_cast<int>(candidates.size());

  // One direction is half the work, but a scale estimated from it shrinks.
  IcpStage first = registration.stage(Target::kCoarseSamples, kFirstSamples, kFirstIterations, 1e-2);
  first.both_directions = options.similarity;
  registration.run(candidates, first);
  registration.score(candidates, registration.stage(Target::kCoarseSamples, kFirstScoreSamples, 0, 0.0));
  registration.prune(candidates, kAfterFirst, std::numeric_limits<double>::infinity());

  registration.run(candidates, registration.stage(Target::kSamples, kSecondSamples, kSecondIterations, 1e-3));
  registration.merge(candidates);
  registration.prune(candidates, kAfterSecond, kNearSecond);

  IcpStage third = registration.stage(Target::kSamples, (options.samples + 1) / 2, options.max_iterations, 1e-4);
  third.variant = options.variant;
  registration.run(candidates, third);
  for (Candidate& candidate : candidates) candidate.by_samples = candidate.state.residual;
  registration.merge(candidates);
  registration.prune(candidates, kAfterThird, kNearThird);

  const Target last = options.to_surface ? Target::kSurface : Target::kSamples;
  if (options.to_surface) {
    IcpStage fourth = registration.stage(last, (options.samples + 1) / 2, options.max_iterations, 1e-5);
    fourth.variant = IcpVariant::kPointToPlane;
    registration.run(candidates, fourth);
  }
  registration.score(candidates, registration.stage(last, options.score_samples, 0, 0.0));
  const auto refined = static_cast<int>(candidates.size());
  IcpResult result = registration.choose(candidates);
  result.starts = starts;
  result.refined = refined;
  return result;
}

}  // namespace anigen::eval
