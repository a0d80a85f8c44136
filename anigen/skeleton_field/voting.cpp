#include "anigen/skeleton_field/voting.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "anigen/asset/mesh.h"
#include "anigen/core/disjoint_sets.h"
#include "anigen/core/error.h"
#include "anigen/core/parallel.h"
#include "anigen/geometry/nearest_point.h"
#include "anigen/skeleton_field/field.h"

namespace anigen::skeleton_field {

namespace {

constexpr double kMostNeighbours = 1 << 16, kMostIterations = 1e9, kMostClusterSize = 1e9;
constexpr int kPaperIterations = 10;

struct ShiftedVotes {
  std::vector<Eigen::Vector3f> positions;
  float farthest = 0.0F;  ///< longest move
};

/// One round of Algorithm 1: S_i ← Σ_k w_k S_k / (Σ_k w_k + 1e-8) over the neighbours of S_i within the bandwidth h,
/// with w_k = c^J_k exp(−‖S_k − S_i‖² / 2h²).
ShiftedVotes shift(const std::vector<Eigen::Vector3f>& positions, const std::vector<float>& confidence,
                   const MeanShiftOptions& options) {
  ShiftedVotes shifted;
  shifted.positions = positions;
  std::vector<float> moves(positions.size(), 0.0F);
  const float falloff = 0.5F / (options.bandwidth * options.bandwidth);
  const geometry::PointCells cells(positions, options.bandwidth);
  const std::size_t most = static_cast<std::size_t>(options.max_neighbours) + 1;
  cells.first_neighbours(most, [&](std::size_t i, const std::vector<geometry::PointCells::Neighbour>& neighbours) {
    float total = 0.0F;
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    // As published, the first neighbour is left out, taken for the vote itself; it is the one of lowest index, often
    // another vote.
    for (std::size_t n = 1; n < neighbours.size(); ++n) {
      const auto k = static_cast<std::size_t>(neighbours[n].index);
      const float weight = confidence[k] * std::exp(-neighbours[n].squared * falloff);
      total += weight;
      sum += weight * positions[k];
    }
    if (!(total > 0.0F)) return;
    shifted.positions[i] = sum / (total + 1e-8F);
    moves[i] = std::sqrt(geometry::squared_distance(shifted.positions[i], positions[i]));
  });
  for (const float move : moves) shifted.farthest = std::max(shifted.farthest, move);
  return shifted;
}

/// One round as the paper has it: S_i ← Σ_k c^J_k S_k / Σ_k c^J_k over all S_k within the bandwidth of S_i, summed in
/// index order and in double.
ShiftedVotes shift_over_all(const std::vector<Eigen::Vector3f>& positions, const std::vector<float>& confidence,
                            float bandwidth) {
  ShiftedVotes shifted;
  shifted.positions = positions;
  std::vector<float> moves(positions.size(), 0.0F);
  const geometry::PointCells cells(positions, bandwidth);
  parallel_for(positions.size(), [&](std::size_t i) {
    std::vector<int> neighbours = cells.within(i);
    std::sort(neighbours.begin(), neighbours.end());
    double total = 0.0;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const int k : neighbours) {
      const auto weight = static_cast<double>(confidence[static_cast<std::size_t>(k)]);
      total += weight;
      sum += weight * positions[static_cast<std::size_t>(k)].cast<double>();
    }
    if (!(total > 0.0)) return;
    shifted.positions[i] = (sum / total).cast<float>();
    moves[i] = std::sqrt(geometry::squared_distance(shifted.positions[i], positions[i]));
  });
  for (const float move : moves) shifted.farthest = std::max(shifted.farthest, move);
  return shifted;
}

/// In index order, a vote without a label opens a new one and gives it to all votes within reach, also to those that
/// have one already. @return number of labels
std::size_t label_votes(const std::vector<Eigen::Vector3f>& positions, float reach, std::vector<int>& labels) {
  const geometry::PointCells cells(positions, reach);
  labels.assign(positions.size(), -1);
  int next = 0;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (labels[i] >= 0) continue;
    for (const int k : cells.within(i)) labels[static_cast<std::size_t>(k)] = next;
    ++next;
  }
  return static_cast<std::size_t>(next);
}

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
  if (!confidences.empty() && confidences.size() != votes)
    throw InputError("", name, std::to_string(confidences.size()) + " for " + std::to_string(votes) + " votes");
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

// The votes both of whose confidences reach the threshold, in order, with confidences filled in.
Votes confident_votes(const Votes& votes, float threshold) {
  const std::size_t count = votes.joints.size();
  if (votes.parents.size() != count)
    throw InputError("", "parents", std::to_string(votes.parents.size()) + " for " + std::to_string(count) + " votes");
  if (count > static_cast<std::size_t>(std::numeric_limits<int>::max()))
    throw InputError("", "joints", "more than 2^31 - 1 votes");
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

// Joints from labelled votes: Ĵ_l = Σ c^J Ĵ / (Σ c^J + 1e-8), so that a label without votes lies at the origin, and
// likewise P̂_l; the parent of a joint is the joint nearest to P̂_l, -1 where that is the joint itself. Labels with fewer
// than `min_size` votes are dropped unless all would be. @param labels [N] of confident votes, in [0, count)
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
  for (std::size_t j = 0; j < nearest.size(); ++j)
    skeleton.parents.push_back(nearest[j].joint == static_cast<int>(j) ? -1 : nearest[j].joint);
  return skeleton;
}

void require_vote_option(const char* name, double value, double low, double high) {
  if (value >= low && value <= high) return;
  throw InputError("", name, "must be from " + std::to_string(low) + " to " + std::to_string(high));
}

}  // namespace

GroupedSkeleton mean_shift_grouping(const Votes& votes, const MeanShiftOptions& options) {
  require_vote_option("bandwidth", options.bandwidth, 1e-6, 1e6);
  require_vote_option("max_iterations", options.max_iterations, 0.0, kMostIterations);
  require_vote_option("max_neighbours", options.max_neighbours, 0.0, kMostNeighbours);
  require_vote_option("min_cluster_size", options.min_cluster_size, 0.0, kMostClusterSize);
  const Votes kept = confident_votes(votes, options.confidence_threshold);
  if (kept.joints.empty()) {
    GroupedSkeleton skeleton;
    if (votes.joints.empty()) return skeleton;
    skeleton.joints.emplace_back(Eigen::Vector3f::Zero());
    skeleton.parents.push_back(0);
    return skeleton;
  }
  std::vector<Eigen::Vector3f> positions = kept.joints;  // S = Ĵ, until max ‖ΔS_i‖ ≤ 0.1 h
  const bool paper = options.form == MeanShiftForm::kPaper;
  const int rounds = paper ? kPaperIterations : options.max_iterations;
  for (int round = 0; round < rounds; ++round) {
    ShiftedVotes shifted = paper ? shift_over_all(positions, kept.joint_confidence, options.bandwidth)
                                 : shift(positions, kept.joint_confidence, options);
    positions = std::move(shifted.positions);
    if (shifted.farthest <= 0.1F * options.bandwidth) break;
  }
  std::vector<int> labels;  // of votes whose S lie within h/2 of each other
  const std::size_t count = label_votes(positions, 0.5F * options.bandwidth, labels);
  return skeleton_of_clusters(kept, labels, count, options.min_cluster_size);
}

GroupedSkeleton threshold_grouping(const Votes& votes, const ThresholdOptions& options) {
  require_vote_option("distance", options.distance, 1e-6, 1e6);
  require_vote_option("max_neighbours", options.max_neighbours, 0.0, kMostNeighbours);
  const Votes kept = confident_votes(votes, options.confidence_threshold);
  const std::size_t count = kept.joints.size();
  std::vector<std::vector<geometry::PointCells::Neighbour>> neighbours(count);
  const geometry::PointCells cells(kept.joints, options.distance);
  cells.first_neighbours(
      static_cast<std::size_t>(options.max_neighbours) + 1,
      [&](std::size_t i, const std::vector<geometry::PointCells::Neighbour>& found) { neighbours[i] = found; });
  // Union by rank; of two equal ranks the first one's root stays, which decides how clusters are numbered.
  DisjointSets forest(count);
  std::vector<int> ranks(count, 0);
  for (std::size_t i = 0; i < count; ++i) {
    // The first one is left out as in the mean shift.
    for (std::size_t n = 1; n < neighbours[i].size(); ++n) {
      std::size_t above = forest.find(i), below = forest.find(static_cast<std::size_t>(neighbours[i][n].index));
      if (above == below) continue;
      if (ranks[above] < ranks[below]) std::swap(above, below);
      if (ranks[above] == ranks[below]) ++ranks[above];
      forest.join(above, below);
    }
  }
  // Clusters are numbered by ascending root.
  std::vector<int> number(count, -1), labels(count);
  int next = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (forest.find(i) == i) number[i] = next++;
  }
  for (std::size_t i = 0; i < count; ++i) labels[i] = number[forest.find(i)];
  return skeleton_of_clusters(kept, labels, static_cast<std::size_t>(next), 0);
}

}  // namespace anigen::skeleton_field
