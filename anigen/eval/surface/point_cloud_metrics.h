#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace anigen::eval {

/// Distances between two point sets A and B, as everything below needs them: computed once with k-d trees.
struct CloudDistances {
  std::vector<double> to_b, to_a;  ///< [A] from each a to the nearest b; [B] from each b to the nearest a
  std::vector<std::size_t> nearest_b, nearest_a;  ///< which one it is
};

/// @throws InputError when a set is empty, or naming a point that is not finite
CloudDistances cloud_distances(const std::vector<Eigen::Vector3d>& a, const std::vector<Eigen::Vector3d>& b);

/// ½ (mean_a d(a, B) + mean_b d(b, A)), distances not squared: the paper's Chamfer (reference
/// training-and-data.md, 7.5).
double chamfer_l1(const CloudDistances& distances);
/// mean_a d² + mean_b d².
double chamfer_l2(const CloudDistances& distances);
/// The largest of all d.
double hausdorff(const CloudDistances& distances);

/// Knapitsch et al. 2017: with A the prediction and B the truth, precision is the share of A within the threshold of B,
/// recall the share of B within the threshold of A, and the F-score their harmonic mean, 0 when both are 0. A point at
/// exactly the threshold is not within.
struct FScore {
  double precision = 0.0, recall = 0.0, fscore = 0.0;
};
/// @throws InputError unless the threshold is positive
FScore fscore(const CloudDistances& distances, double threshold);

/// ½ (mean_a |n_a · n_nearest b| + mean_b |n_b · n_nearest a|): 1 for parallel surfaces, whichever way they face.
/// @param a_normals,b_normals unit length, or 0 where there is none, which scores 0
/// @throws InputError when there is not one normal per point
double normal_consistency(const CloudDistances& distances, const std::vector<Eigen::Vector3d>& a_normals,
                          const std::vector<Eigen::Vector3d>& b_normals);

}  // namespace anigen::eval
