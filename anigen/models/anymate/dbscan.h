#pragma once
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::models::anymate {

using torch::Tensor;

struct DbscanOptions {
  double eps = 0.03;             ///< reach of a point, inclusive
  std::int64_t min_samples = 1;  ///< points within reach, itself included, that make a point a core point
};

/// Clusters of points (Ester et al. 1996). Core points within reach of each other share a cluster, numbered by the
/// first core point in index order; a point in reach of cores of several clusters joins the first of them; the others
/// are noise. With min_samples 1 nothing is noise, and clusters are the connected components of "distance <= eps".
/// @param points [N, 3] floating, any device; distances in fp64
/// @return [N] labels from 0, -1 for noise @throws InputError for a shape, an option out of range or a point that is
/// not
///   finite
std::vector<std::int64_t> dbscan_labels(const Tensor& points, const DbscanOptions& options);

/// Mean of each cluster in label order, formed in fp64; noise is left out.
/// @param points [N, 3] @return [K, 3], dtype of the points, on the CPU
Tensor cluster_means(const Tensor& points, const std::vector<std::int64_t>& labels);

/// What turns the joints of a regression or a diffusion into a set: the means of dbscan_labels. The released eps is
/// 0.03 for regression and 0.05 for diffusion (reference anymate-baselines.md, 3.1 and 3.2).
Tensor merged_joints(const Tensor& joints, const DbscanOptions& options = {});

}  // namespace anigen::models::anymate
