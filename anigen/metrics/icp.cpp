#include "anigen/metrics/icp.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"

namespace anigen::metrics {

namespace {

constexpr double kAmbiguous = 1.1;  // ratio of variances below which two axes may be swapped

bool ambiguous(const Eigen::Vector3d& ascending) {
  return ascending[1] < kAmbiguous * ascending[0] || ascending[2] < kAmbiguous * ascending[1];
}

constexpr double kExact = 1e-14;      // residual, as a share of the target's size, that is rounding alone
constexpr double kLongestTurn = 0.5;  // radians a single linearised step may turn by

struct Pair {
  Eigen::Vector3d from;    ///< in the source's frame
  Eigen::Vector3d to;      ///< in the target's frame
  Eigen::Vector3d normal;  ///< in the target's frame; zero where unknown
  double squared;          ///< of the distance, in the target's frame
  double weight;
};

/// Nearest points of one shape, by whatever the stage looks up in; remembers answers as guesses for the next iteration.
class Lookup {
 public:
  Lookup(const AlignmentShape& shape, const IcpStage& stage, std::size_t queries)
      : index_(stage.target == IcpStage::Target::kCoarseSamples ? shape.coarse_index() : shape.index()),
        normals_(shape.normals()),
        surface_(stage.target == IcpStage::Target::kSurface ? shape.surface() : nullptr),
        guesses_(queries, -1) {}

  /// @param normal of the surface there, or zero
  Eigen::Vector3d nearest(std::size_t query, const Eigen::Vector3d& point, Eigen::Vector3d& normal) {
    std::int32_t& guess = guesses_[query];
    if (surface_ != nullptr) {
      const geometry::NearestPoint found = guess >= 0 ? surface_->query(point, guess) : surface_->query(point);
      guess = found.at.face;
      // The distance to a surface falls fastest along the way to its nearest point, on edges and corners, too.
      normal =
          found.distance > 0.0 ? Eigen::Vector3d((point - found.position) / found.distance) : Eigen::Vector3d::Zero();
      return found.position;
    }
    const geometry::PointIndex::Nearest found =
        guess >= 0 ? index_.nearest(point, static_cast<std::size_t>(guess)) : index_.nearest(point);
    guess = static_cast<std::int32_t>(found.index);
    normal = normals_[found.index];
    return index_.point(found.index);
  }

 private:
  const geometry::PointIndex& index_;
  const std::vector<Eigen::Vector3d>& normals_;
  const geometry::NearestSurface* surface_;
  std::vector<std::int32_t> guesses_;
};

class Stage {
 public:
  Stage(const AlignmentShape& source, const AlignmentShape& target, const IcpStage& stage)
      : source_(source),
        target_(target),
        stage_(stage),
        from_count_(std::min(stage.samples, source.points().size())),
        to_count_(stage.both_directions ? std::min(stage.samples, target.points().size()) : 0),
        in_target_(target, stage, from_count_),
        in_source_(source, stage, to_count_) {}

  /// Pairs under a transform. @return mean squared distance of the kept ones
  double collect(const Similarity& transform, std::vector<Pair>& pairs) {
    pairs.resize(from_count_ + to_count_);
    for (std::size_t i = 0; i < from_count_; ++i) {
      Pair& pair = pairs[i];
      pair.from = source_.points()[i];
      const Eigen::Vector3d moved = transform(pair.from);
      pair.to = in_target_.nearest(i, moved, pair.normal);
      pair.squared = (moved - pair.to).squaredNorm();
    }
    const Similarity back = transform.inverse();
    for (std::size_t i = 0; i < to_count_; ++i) {
      Pair& pair = pairs[from_count_ + i];
      pair.to = target_.points()[i];
      pair.from = in_source_.nearest(i, back(pair.to), pair.normal);
      pair.normal = transform.rotation * pair.normal;
      pair.squared = (transform(pair.from) - pair.to).squaredNorm();
    }
    if (to_count_ == 0) return keep(pairs, 0, from_count_, 1.0);
    return keep(pairs, 0, from_count_, 0.5) + keep(pairs, from_count_, pairs.size(), 0.5);
  }

  Similarity closed_form(const std::vector<Pair>& pairs) const {
    ProcrustesSums sums;
    for (const Pair& pair : pairs) {
      if (pair.weight > 0.0) sums.add(pair.from, pair.to, pair.weight);
    }
    return sums.solve(stage_.similarity ? PairScale::kLeastSquares : PairScale::kFixed);
  }

  /// One Gauss–Newton step on the distances along the normals: a small turn, a shift and a change of size around the
  /// target's centroid.
  Similarity plane_step(const std::vector<Pair>& pairs, const Similarity& current) const {
    using Vector7d = Eigen::Matrix<double, 7, 1>;
    using Matrix7d = Eigen::Matrix<double, 7, 7>;
    Matrix7d normal_matrix = Matrix7d::Zero();
    Vector7d right = Vector7d::Zero();
    const Eigen::Vector3d center = target_.centroid();
    for (const Pair& pair : pairs) {
      if (!(pair.weight > 0.0)) continue;
      const Eigen::Vector3d moved = current(pair.from), arm = moved - center;
      Vector7d row;
      row << arm.cross(pair.normal), pair.normal, stage_.similarity ? pair.normal.dot(arm) : 0.0;
      normal_matrix.selfadjointView<Eigen::Lower>().rankUpdate(row, pair.weight);
      right -= pair.weight * pair.normal.dot(moved - pair.to) * row;
    }
    // Motion that the normals leave undetermined (a plane slides, a sphere turns) stays where it is.
    const double size = std::max(normal_matrix.diagonal().maxCoeff(), std::numeric_limits<double>::min());
    normal_matrix.diagonal().array() += 1e-9 * size;
    const Vector7d step = normal_matrix.selfadjointView<Eigen::Lower>().ldlt().solve(right);
    if (!step.allFinite()) return current;
    Similarity change;
    const double angle = step.head<3>().norm();
    if (angle > 0.0)
      change.rotation = Eigen::AngleAxisd(std::min(angle, kLongestTurn), step.head<3>() / angle).toRotationMatrix();
    change.scale = std::exp(std::clamp(step[6], -0.5, 0.5));
    change.translation = center + step.segment<3>(3) - change.scale * (change.rotation * center);
    return compose(change, current);
  }

 private:
  /// Gives weights to one direction's pairs; the farthest get none.
  double keep(std::vector<Pair>& pairs, std::size_t begin, std::size_t end, double share) {
    const std::size_t count = end - begin;
    const auto kept = std::clamp<std::size_t>(
        static_cast<std::size_t>(std::ceil(stage_.trim * static_cast<double>(count))), 1, count);
    double limit = std::numeric_limits<double>::infinity();
    if (kept < count) {
      distances_.clear();
      for (std::size_t i = begin; i < end; ++i) distances_.push_back(pairs[i].squared);
      const auto middle = distances_.begin() + static_cast<std::ptrdiff_t>(kept - 1);
      std::nth_element(distances_.begin(), middle, distances_.end());
      limit = *middle;
    }
    std::size_t taken = 0;
    double sum = 0.0;
    for (std::size_t i = begin; i < end; ++i) {
      const bool inside = pairs[i].squared <= limit;
      pairs[i].weight = inside ? share : 0.0;
      taken += inside ? 1 : 0;
      sum += inside ? pairs[i].squared : 0.0;
    }
    for (std::size_t i = begin; i < end; ++i) pairs[i].weight /= static_cast<double>(taken);
    return share * sum / static_cast<double>(taken);
  }

  const AlignmentShape& source_;
  const AlignmentShape& target_;
  const IcpStage& stage_;
  std::size_t from_count_, to_count_;
  Lookup in_target_, in_source_;
  std::vector<double> distances_;
};

// The rule in icp.h.
constexpr std::size_t kFirstSamples = 100, kFirstScoreSamples = 200, kSecondSamples = 250;
constexpr int kFirstIterations = 15, kSecondIterations = 20;
constexpr std::size_t kAfterFirst = 16, kAfterSecond = 8, kAfterThird = 4;
constexpr double kNearSecond = 1.3, kNearThird = 1.1;
// Largest distance between two samplings of one surface, as a share of its size: no candidate below is worse than
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

Eigen::Matrix3d random_rotation(Rng& rng) {
  const double u = rng.uniform(), v = 2.0 * kPi * rng.uniform(), w = 2.0 * kPi * rng.uniform();
  const double a = std::sqrt(1.0 - u), b = std::sqrt(u);
  return Eigen::Quaterniond(b * std::cos(w), a * std::sin(v), a * std::cos(v), b * std::sin(w))
      .normalized()
      .toRotationMatrix();
}

std::vector<Eigen::Matrix3d> random_rotations(int count, std::uint64_t seed) {
  std::vector<Eigen::Matrix3d> rotations;
  for (int i = 0; i < count; ++i) {
    Rng rng(seed, "alignment rotation", static_cast<std::uint64_t>(i));
    rotations.push_back(random_rotation(rng));
  }
  return rotations;
}

std::vector<Eigen::Matrix3d> principal_axis_rotations(const Eigen::Matrix3d& from_covariance,
                                                      const Eigen::Matrix3d& to_covariance) {
  if (!(from_covariance.trace() > 0.0) || !(to_covariance.trace() > 0.0)) return {};
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> from(from_covariance), to(to_covariance);
  const bool all = ambiguous(from.eigenvalues()) || ambiguous(to.eigenvalues());
  std::vector<Eigen::Matrix3d> rotations;
  std::array<int, 3> order = {0, 1, 2};
  do {
    for (int signs = 0; signs < 8; ++signs) {
      Eigen::Matrix3d axes;
      for (int k = 0; k < 3; ++k) axes.col(k) = (signs & (1 << k) ? -1.0 : 1.0) * from.eigenvectors().col(order[at(k)]);
      const Eigen::Matrix3d rotation = to.eigenvectors() * axes.transpose();
      if (rotation.determinant() > 0.0) rotations.push_back(rotation);
    }
  } while (all && std::next_permutation(order.begin(), order.end()));
  return rotations;
}

IcpState run_stage(const AlignmentShape& source, const AlignmentShape& target, const Similarity& start,
                   const IcpStage& options) {
  Stage stage(source, target, options);
  IcpState state;
  state.transform = start;
  std::vector<Pair> pairs, next_pairs;
  double squared = stage.collect(state.transform, pairs);
  const double exact = std::pow(kExact * target.rms_radius(), 2);
  while (state.iterations < options.max_iterations && squared > exact) {
    const bool plane = options.variant == IcpVariant::kPointToPlane;
    Similarity next = plane ? stage.plane_step(pairs, state.transform) : stage.closed_form(pairs);
    double next_squared = stage.collect(next, next_pairs);
    if (plane && !(next_squared < squared)) {
      next = stage.closed_form(pairs);
      next_squared = stage.collect(next, next_pairs);
    }
    ++state.iterations;
    if (!(next_squared < squared)) break;
    const bool done = std::sqrt(squared) - std::sqrt(next_squared) <= options.tolerance * std::sqrt(squared);
    state.transform = next;
    squared = next_squared;
    pairs.swap(next_pairs);
    if (done) break;
  }
  state.residual = std::sqrt(squared);
  return state;
}

double stage_residual(const AlignmentShape& source, const AlignmentShape& target, const Similarity& transform,
                      const IcpStage& options) {
  std::vector<Pair> pairs;
  return std::sqrt(Stage(source, target, options).collect(transform, pairs));
}

void check(const IcpOptions& options) {
  require_between(options.rotations, 0, 100000, "rotations");
  require_between(static_cast<double>(options.samples), 1, 10000000, "samples");
  require_between(static_cast<double>(options.score_samples), 1, 10000000, "score_samples");
  require_between(options.max_iterations, 0, 100000, "max_iterations");
  if (!(options.trim > 0.0 && options.trim <= 1.0)) throw InputError("", "trim", "must be in (0, 1]");
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

IcpState plain_icp(const std::vector<Eigen::Vector3d>& source, const NearestPointFunction& nearest,
                   const Similarity& start, int max_iterations, double threshold, bool similarity) {
  if (source.empty()) throw InputError("", "points", "there is no point to align");
  for (std::size_t i = 0; i < source.size(); ++i) {
    if (!source[i].allFinite()) throw InputError("", "points[" + std::to_string(i) + "]", "the position is not finite");
  }
  const auto count = static_cast<double>(source.size());
  IcpState state;
  state.transform = start;
  double before = std::numeric_limits<double>::infinity();
  std::vector<Eigen::Vector3d> goals(source.size());
  while (state.iterations < max_iterations) {
    ProcrustesSums sums;
    for (std::size_t i = 0; i < source.size(); ++i) {
      goals[i] = nearest(state.transform(source[i]));
      sums.add(source[i], goals[i]);
    }
    state.transform = sums.solve(similarity ? PairScale::kLeastSquares : PairScale::kFixed);
    ++state.iterations;
    double squared = 0.0;
    for (std::size_t i = 0; i < source.size(); ++i) squared += (state.transform(source[i]) - goals[i]).squaredNorm();
    state.residual = std::sqrt(squared / count);
    if (before - squared / count < threshold) break;
    before = squared / count;
  }
  return state;
}

}  // namespace anigen::metrics
