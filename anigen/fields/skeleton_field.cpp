#include "anigen/fields/skeleton_field.h"

#include <vector>

#include "anigen/core/error.h"
#include "anigen/fields/tensor_points.h"

namespace anigen::fields {
namespace {

std::vector<float> confidences_of(const Tensor& confidence, std::int64_t votes, const char* name) {
  if (!confidence.defined()) return {};
  require_matrix(confidence, votes, 1, name);
  const Tensor values = confidence.detach().to(torch::kCPU, torch::kFloat32).contiguous();
  return {values.data_ptr<float>(), values.data_ptr<float>() + values.numel()};
}

}  // namespace

Grouping grouping_named(const std::string& name) {
  if (name == "mean_shift") return Grouping::kMeanShift;
  if (name == "threshold") return Grouping::kThreshold;
  throw InputError("", "", "no grouping is called '" + name + "': mean_shift or threshold");
}

geometry::Votes votes_of(const SkeletonField& field) {
  geometry::Votes votes;
  votes.joints = points_of<float>(field.joints, "joints");
  require_matrix(field.parents, field.joints.size(0), 3, "parents");
  votes.parents = points_of<float>(field.parents, "parents");
  votes.joint_confidence = confidences_of(field.conf_j, field.joints.size(0), "conf_j");
  votes.parent_confidence = confidences_of(field.conf_p, field.joints.size(0), "conf_p");
  return votes;
}

SkeletonTensors group_votes(const SkeletonField& field, const std::string& strategy,
                            const geometry::MeanShiftOptions& mean_shift, const geometry::ThresholdOptions& threshold) {
  const bool is_mean_shift = grouping_named(strategy) == Grouping::kMeanShift;
  const geometry::Votes votes = votes_of(field);
  const geometry::GroupedSkeleton skeleton =
      is_mean_shift ? geometry::mean_shift_grouping(votes, mean_shift) : geometry::threshold_grouping(votes, threshold);
  const auto count = static_cast<std::int64_t>(skeleton.joints.size());
  SkeletonTensors tensors{torch::empty({count, 3}, torch::kFloat32), torch::empty({count}, torch::kInt64)};
  float* joints = tensors.joints.data_ptr<float>();
  auto* parents = tensors.parents.data_ptr<std::int64_t>();
  for (std::size_t j = 0; j < skeleton.joints.size(); ++j) {
    for (const float x : skeleton.joints[j]) *joints++ = x;
    *parents++ = skeleton.parents[j];
  }
  const torch::Device device = field.joints.device();
  return {tensors.joints.to(device), tensors.parents.to(device)};
}

}  // namespace anigen::fields
