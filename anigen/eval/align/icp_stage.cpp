#include "anigen/eval/align/icp_stage.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>

#include "anigen/eval/align/procrustes.h"

namespace anigen::eval {
namespace {

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
    const PointIndex::Nearest found =
        guess >= 0 ? index_.nearest(point, static_cast<std::size_t>(guess)) : index_.nearest(point);
    guess = static_cast<std::int32_t>(found.index);
    normal = normals_[found.index];
    return index_.point(found.index);
  }

 private:
  const PointIndex& index_;
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
    // What the normals leave undetermined (a plane slides, a sphere turns) stays where it is.
    const double size = std::max(normal_matrix.diagonal().maxCoeff(), std::numeric_limits<double>::min());
    normal_matrix.diagonal().array() += 1e-9 * size;
    const Vector7d step = normal_matrix.selfadjointView<Eigen::Lower>().ldlt().solve(right);
    if (!step.allFinite()) return current;
    Similarity change;
    const double angle = step.head<3>().norm();
    if (angle > 0.0) {
      change.rotation = Eigen::AngleAxisd(std::min(angle, kLongestTurn), step.head<3>() / angle).toRotationMatrix();
    }
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

}  // namespace

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

}  // namespace anigen::eval
