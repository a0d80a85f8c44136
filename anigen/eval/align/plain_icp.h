#pragma once
#include <Eigen/Core>
#include <functional>
#include <vector>

#include "anigen/eval/align/icp_stage.h"
#include "anigen/eval/align/similarity.h"

namespace anigen::eval {

/// Nearest point of the target, in the target's frame.
using NearestPointFunction = std::function<Eigen::Vector3d(const Eigen::Vector3d&)>;

/// Plain ICP from one start, in one direction: nearest points, Procrustes on the pairs, until an iteration lowers the
/// mean squared distance by less than `threshold` or max_iterations were made (Besl and McKay 1992).
/// @throws InputError without points, or on one that is not finite
IcpState plain_icp(const std::vector<Eigen::Vector3d>& source, const NearestPointFunction& nearest,
                   const Similarity& start, int max_iterations, double threshold, bool similarity = false);

}  // namespace anigen::eval
