#include "anigen/geometry/vote_clustering.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "anigen/geometry/point_cells.h"
#include "anigen/geometry/vote_clusters.h"

namespace anigen::geometry {
namespace {

constexpr double kMostNeighbours = 1 << 16, kMostIterations = 1e9, kMostClusterSize = 1e9;

struct ShiftedVotes {
  std::vector<Eigen::Vector3f> positions;
  float farthest = 0.0F;  ///< longest move
};

/// One round: every vote moves to the mean of its neighbours, weighted by a Gaussian and by confidence.
ShiftedVotes shift(const std::vector<Eigen::Vector3f>& positions, const std::vector<float>& confidence,
                   const MeanShiftOptions& options) {
  ShiftedVotes shifted;
  shifted.positions = positions;
  std::vector<float> moves(positions.size(), 0.0F);
  const float falloff = 0.5F / (options.bandwidth * options.bandwidth);
  const PointCells cells(positions, options.bandwidth);
  const std::size_t most = static_cast<std::size_t>(options.max_neighbours) + 1;
  cells.first_neighbours(most, [&](std::size_t i, const std::vector<PointCells::Neighbour>& neighbours) {
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
    moves[i] = std::sqrt(squared_distance(shifted.positions[i], positions[i]));
  });
  for (const float move : moves) shifted.farthest = std::max(shifted.farthest, move);
  return shifted;
}

/// In index order, a vote without a label opens a new one and gives it to all votes within reach, also to those that
/// have one already. @return number of labels
std::size_t label_votes(const std::vector<Eigen::Vector3f>& positions, float reach, std::vector<int>& labels) {
  const PointCells cells(positions, reach);
  labels.assign(positions.size(), -1);
  int next = 0;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (labels[i] >= 0) continue;
    for (const int k : cells.within(i)) labels[static_cast<std::size_t>(k)] = next;
    ++next;
  }
  return static_cast<std::size_t>(next);
}

/// Union by rank; of two equal ranks the first one's root stays.
class VoteForest {
 public:
  explicit VoteForest(std::size_t count) : parents_(count), ranks_(count, 0) {
    std::iota(parents_.begin(), parents_.end(), 0);
  }

  int root(int vote) {
    while (parent(vote) != vote) {
      parent(vote) = parent(parent(vote));
      vote = parent(vote);
    }
    return vote;
  }

  void join(int first, int second) {
    int above = root(first), below = root(second);
    if (above == below) return;
    if (rank(above) < rank(below)) std::swap(above, below);
    if (rank(above) == rank(below)) ++rank(above);
    parent(below) = above;
  }

 private:
  int& parent(int vote) { return parents_[static_cast<std::size_t>(vote)]; }
  int& rank(int vote) { return ranks_[static_cast<std::size_t>(vote)]; }

  std::vector<int> parents_, ranks_;
};

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
  std::vector<Eigen::Vector3f> positions = kept.joints;
  for (int round = 0; round < options.max_iterations; ++round) {
    ShiftedVotes shifted = shift(positions, kept.joint_confidence, options);
    positions = std::move(shifted.positions);
    if (shifted.farthest <= 0.1F * options.bandwidth) break;
  }
  std::vector<int> labels;
  const std::size_t count = label_votes(positions, 0.5F * options.bandwidth, labels);
  return skeleton_of_clusters(kept, labels, count, options.min_cluster_size);
}

GroupedSkeleton threshold_grouping(const Votes& votes, const ThresholdOptions& options) {
  require_vote_option("distance", options.distance, 1e-6, 1e6);
  require_vote_option("max_neighbours", options.max_neighbours, 0.0, kMostNeighbours);
  const Votes kept = confident_votes(votes, options.confidence_threshold);
  const std::size_t count = kept.joints.size();
  std::vector<std::vector<PointCells::Neighbour>> neighbours(count);
  const PointCells cells(kept.joints, options.distance);
  cells.first_neighbours(
      static_cast<std::size_t>(options.max_neighbours) + 1,
      [&](std::size_t i, const std::vector<PointCells::Neighbour>& found) { neighbours[i] = found; });
  VoteForest forest(count);
  for (std::size_t i = 0; i < count; ++i) {
    // The first one is left out as in the mean shift.
    for (std::size_t n = 1; n < neighbours[i].size(); ++n) forest.join(static_cast<int>(i), neighbours[i][n].index);
  }
  // Clusters are numbered by ascending root.
  std::vector<int> number(count, -1), labels(count);
  int next = 0;
  for (std::size_t i = 0; i < count; ++i) {
    if (forest.root(static_cast<int>(i)) == static_cast<int>(i)) number[i] = next++;
  }
  for (std::size_t i = 0; i < count; ++i) {
    labels[i] = number[static_cast<std::size_t>(forest.root(static_cast<int>(i)))];
  }
  return skeleton_of_clusters(kept, labels, static_cast<std::size_t>(next), 0);
}

}  // namespace anigen::geometry
