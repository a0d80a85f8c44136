#include "anigen/skeleton_field/loss.h"

#include <algorithm>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/init.h"

namespace anigen::skeleton_field {

namespace {

using torch::Tensor;

constexpr double kLeastSpacing = 1e-6;  // squared
constexpr double kMostWeight = 10.0;
constexpr double kLeastLogConfidence = 32.0;
constexpr double kMostLogScale = 10.0;

// Squared distance of each joint to its nearest other joint → how much it counts.
Tensor crowding_weights(const std::vector<Eigen::Vector3d>& joints) {
  const std::vector<NearestJoints> nearest = nearest_joints(joints, joints);
  std::vector<double> spacing;
  for (const NearestJoints& one : nearest) spacing.push_back(std::max(one.second, kLeastSpacing));
  const double widest = *std::max_element(spacing.begin(), spacing.end());
  std::vector<float> weights;
  for (const double own : spacing) weights.push_back(static_cast<float>(std::clamp(widest / own, 1.0, kMostWeight)));
  return torch::tensor(weights, torch::kFloat32);
}

// L_J or L_P = mean c ‖Ĵ − J‖ of the votes for joints or for parents, c the target κ or what the confidence says.
// Differences [M, 3], weights and targets [M, 1].
Tensor vote_loss(const Tensor& difference, const Tensor& weight, const Tensor& target, const Tensor& confidence,
                 double alpha, const SkeletonLossOptions& options) {
  const Tensor plain = options.squared ? difference.square().sum(1, /*keepdim=*/true) : difference.abs();
  const Tensor distance = plain * weight;
  switch (options.confidence) {
    case FieldConfidence::kNone:
      return distance.mean();
    case FieldConfidence::kExplicit:
      return (target * distance).mean() + (confidence - target).abs().mean();
    case FieldConfidence::kLearned: {
      const Tensor c = torch::exp(confidence) + 1.0;
      const Tensor barrier = -alpha * torch::log(c).clamp_min(kLeastLogConfidence);
      return (c * distance + (barrier - barrier.detach())).mean();
    }
    default: {
      // −log of a Laplace density per coordinate, or of a normal one for squared distances, up to constants.
      const Tensor s = clamped_log_scale(confidence);
      const Tensor cost = torch::exp(-s) * distance + s;
      return options.squared ? 0.5 * cost.mean() : cost.mean();
    }
  }
}

}  // namespace

SkeletonLossOptions SkeletonLossOptions::compatible(const std::string& compatibility) {
  SkeletonLossOptions options;
  if (compatibility == "published") return options;
  if (compatibility != "paper")
    throw InputError("", "compatibility", "expected published or paper, found '" + compatibility.substr(0, 80) + "'");
  options.least_confidence = 0.0;
  options.crowding = false;
  options.squared = true;
  return options;
}

SkeletonTargets skeleton_targets(const Tensor& positions, const Tensor& joints, const Tensor& parents,
                                 const SkeletonLossOptions& options) {
  const std::vector<Eigen::Vector3d> places = nn::points_of<double>(positions, "positions"),
                                     bones = nn::points_of<double>(joints, "joints");
  const Tensor links = parents.to(torch::kCPU, torch::kInt64).contiguous();
  if (links.dim() != 1 || links.size(0) != static_cast<std::int64_t>(bones.size()))
    throw InputError("", "parents", "there must be one parent per joint");
  const std::vector<NearestJoints> nearest = nearest_joints(places, bones);
  const auto count = static_cast<std::int64_t>(places.size());
  const Tensor joint = torch::empty({count}, torch::kInt64), parent = torch::empty({count}, torch::kInt64);
  const Tensor confidence = torch::empty({count, 1}, torch::kFloat32);
  const std::int64_t* link = links.data_ptr<std::int64_t>();
  for (std::size_t i = 0; i < nearest.size(); ++i) {
    const std::int64_t own = nearest[i].joint;
    joint.data_ptr<std::int64_t>()[i] = own;
    // The published loss takes joint 0 for the parent of a root, which is the root itself where it stands first.
    parent.data_ptr<std::int64_t>()[i] = std::max<std::int64_t>(0, link[own]);
    confidence.data_ptr<float>()[i] =
        static_cast<float>(std::max(options.least_confidence, joint_confidence(nearest[i])));
  }
  const torch::Device device = positions.device();
  const Tensor weight = options.crowding ? crowding_weights(bones)
                                         : torch::ones({static_cast<std::int64_t>(bones.size())}, torch::kFloat32);
  return {joints.detach().to(device, torch::kFloat32), joint.to(device), parent.to(device), confidence.to(device),
          weight.to(device)};
}

SkeletonLosses skeleton_losses(const SkeletonField& predicted, const SkeletonTargets& targets,
                               const SkeletonLossOptions& options) {
  const bool needs_confidence = options.confidence != FieldConfidence::kNone;
  if (needs_confidence && !(predicted.conf_j.defined() && predicted.conf_p.defined()))
    throw InputError("", "", "this loss needs the confidences of a skeleton field");
  const auto loss = [&](const Tensor& votes, const Tensor& rows, const Tensor& confidence, double alpha) {
    const Tensor difference = votes - targets.joints.index_select(0, rows);
    const Tensor weight = targets.weight.index_select(0, rows).unsqueeze(1);
    return vote_loss(difference, weight, targets.confidence, confidence, alpha, options);
  };
  return {loss(predicted.joints, targets.joint, predicted.conf_j, options.alpha_conf_j),
          loss(predicted.parents, targets.parent, predicted.conf_p, options.alpha_conf_p)};
}

Tensor clamped_log_scale(const Tensor& s) { return s.clamp(-kMostLogScale, kMostLogScale); }

}  // namespace anigen::skeleton_field
