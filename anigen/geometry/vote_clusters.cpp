#include "anigen/geometry/vote_clusters.h"

#include <cmath>
#include <limits>
#include <string>

#include "anigen/core/error.h"
#include "anigen/geometry/joint_field.h"

namespace anigen::geometry {
namespace {

// Keeps squared distances and weighted sums within single precision; object space ends at 0.5.
constexpr float kFarthestVote = 1e15F;

bool is_usable(float value) { return std::abs(value) <= kFarthestVote; }  // false for NaN

void require_votes(const std::vector<Eigen::Vector3f>& positions, const char* name) {
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const Eigen::Vector3f& p = positions[i];
    if (is_usable(p.x()) && is_usable(p.y()) && is_usable(p.z())) continue;
    throw InputError("", std::string(name) + "[" + std::to_string(i) + "]", "a vote is not finite, or beyond 1e15");
  }
}

void require_confidences(const std::vector<float>& confidences, std::size_t votes, const char* name) {
  if (!confidences.empty() && confidences.size() != votes) {
    throw InputError("", name, std::to_string(confidences.size()) + " for " + std::to_string(votes) + " votes");
  }
  for (std::size_t i = 0; i < confidences.size(); ++i) {
    if (is_usable(confidences[i])) continue;
    throw InputError("", std::string(name) + "[" + std::to_string(i) + "]",
                     "the confidence of a vote is not finite, or beyond 1e15");
  }
}

// Weighted sums in double: a joint may have 1e5 votes.
struct WeightedMean {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double weight = 0.0;

  void add(const Eigen::Vector3f& position, float confidence) {
    sum += static_cast<double>(confidence) * position.cast<double>();
    weight += static_cast<double>(confidence);
  }
  Eigen::Vector3d mean() const { return sum / (weight + 1e-8); }
};

std::vector<Eigen::Vector3d> in_double(const std::vector<Eigen::Vector3f>& points) {
  std::vector<Eigen::Vector3d> result;
  result.reserve(points.size());
  for (const Eigen::Vector3f& point : points) result.emplace_back(point.cast<double>());
  return result;
}

}  // namespace

Votes confident_votes(const Votes& votes, float threshold) {
  const std::size_t count = votes.joints.size();
  if (votes.parents.size() != count) {
    throw InputError("", "parents", std::to_string(votes.parents.size()) + " for " + std::to_string(count) + " votes");
  }
  if (count > static_cast<std::size_t>(std::numeric_limits<int>::max())) {
    throw InputError("", "joints", "more than 2^31 - 1 votes");
  }
  require_votes(votes.joints, "joints");
  require_votes(votes.parents, "parents");
  require_confidences(votes.joint_confidence, count, "joint_confidence");
  require_confidences(votes.parent_confidence, count, "parent_confidence");
  Votes kept;
  for (std::size_t i = 0; i < count; ++i) {
    const float joint = votes.joint_confidence.empty() ? 1.0F : votes.joint_confidence[i];
    const float parent = votes.parent_confidence.empty() ? 1.0F : votes.parent_confidence[i];
    if (!(joint >= threshold && parent >= threshold)) continue;
    kept.joints.push_back(votes.joints[i]);
    kept.parents.push_back(votes.parents[i]);
    kept.joint_confidence.push_back(joint);
    kept.parent_confidence.push_back(parent);
  }
  return kept;
}

GroupedSkeleton skeleton_of_clusters(const Votes& votes, const std::vector<int>& labels, std::size_t count,
                                     int min_size) {
  std::vector<WeightedMean> joints(count), parents(count);
  std::vector<int> sizes(count, 0);
  for (std::size_t i = 0; i < labels.size(); ++i) {
    const auto label = static_cast<std::size_t>(labels[i]);
    joints[label].add(votes.joints[i], votes.joint_confidence[i]);
    parents[label].add(votes.parents[i], votes.parent_confidence[i]);
    ++sizes[label];
  }
  bool any_large = false;
  for (const int size : sizes) any_large = any_large || size >= min_size;
  GroupedSkeleton skeleton;
  std::vector<Eigen::Vector3f> parent_positions;
  for (std::size_t label = 0; label < count; ++label) {
    if (any_large && sizes[label] < min_size) continue;
    skeleton.joints.emplace_back(joints[label].mean().cast<float>());
    parent_positions.emplace_back(parents[label].mean().cast<float>());
  }
  if (skeleton.joints.empty()) return skeleton;
  const std::vector<NearestJoints> nearest = nearest_joints(in_double(parent_positions), in_double(skeleton.joints));
  for (std::size_t j = 0; j < nearest.size(); ++j) {
    skeleton.parents.push_back(nearest[j].joint == static_cast<int>(j) ? -1 : nearest[j].joint);
  }
  return skeleton;
}

void require_vote_option(const char* name, double value, double low, double high) {
  if (value >= low && value <= high) return;
  throw InputError("", name, "must be from " + std::to_string(low) + " to " + std::to_string(high));
}

}  // namespace anigen::geometry
