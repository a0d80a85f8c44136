#pragma once
#include <Eigen/Core>
#include <vector>

namespace anigen::skeleton_field {

/// Votes of each skeleton voxel for its joint and that joint's parent (docs/reference/autoencoders.md, 5.4).
struct Votes {
  std::vector<Eigen::Vector3f> joints, parents;            ///< [N] positions
  std::vector<float> joint_confidence, parent_confidence;  ///< [N], or empty: all 1
};

struct GroupedSkeleton {
  std::vector<Eigen::Vector3f> joints;
  std::vector<int> parents;  ///< -1 for a root; raw as published: none or several roots and cycles can occur
};

/// Forms of Algorithm 1 (docs/divergences.md). Thresholds, merging and the least size of a cluster are common to both:
/// the paper's text does not say them.
enum class MeanShiftForm {
  kOfRun,      ///< as a run's config says (structured_latent::grouping_of_run); without a run as kPublished
  kPublished,  ///< at most max_iterations rounds over the first max_neighbours, weights c^J exp(−d² / 2h²)
  kPaper       ///< at most 10 rounds over all votes within the bandwidth, the vote itself among them, weights c^J
};

struct MeanShiftOptions {
  float confidence_threshold = 0.5F;
  float bandwidth = 0.01F;   ///< published `threshold`
  int max_iterations = 30;   ///< of kPublished
  int max_neighbours = 32;   ///< of kPublished
  int min_cluster_size = 5;  ///< published `cluster_size_threshold`
  MeanShiftForm form = MeanShiftForm::kOfRun;
};

struct ThresholdOptions {
  float confidence_threshold = 0.1F;
  float distance = 1.0F / 32.0F;  ///< published `threshold`
  int max_neighbours = 8;
};

/// Algorithm 1 of the paper, as published or as the paper has it: votes move to where votes are densest, and those that
/// end within half a bandwidth of each other become one joint. Votes count whose confidences both reach the threshold.
/// Neighbours are found in a grid of cells (see PointCells) with the same result, bit for bit, as comparing all pairs,
/// on any number of threads; of the published form those of lowest index. The paper's form takes time that grows with
/// the square of the votes that stand within a bandwidth of each other.
/// Without a confident vote the result is one joint at the origin that is its own parent (index 0, not -1), and without
/// any vote an empty skeleton. A single confident vote, which the published program fails on, is one root.
/// @throws InputError naming the vote: a position that is not finite or beyond 1e15, a confidence likewise; when
/// lengths
///   differ; on a bandwidth outside [1e-6, 1e6] or a negative count
GroupedSkeleton mean_shift_grouping(const Votes& votes, const MeanShiftOptions& options = {});

/// The published alternative: union-find over votes closer than a distance. Empty without a confident vote.
/// @throws InputError as mean_shift_grouping
GroupedSkeleton threshold_grouping(const Votes& votes, const ThresholdOptions& options = {});

}  // namespace anigen::skeleton_field
