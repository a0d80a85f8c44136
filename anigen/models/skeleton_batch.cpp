#include "anigen/models/skeleton_batch.h"

#include <string>

#include "anigen/core/error.h"

namespace anigen::models {
namespace {

using torch::Tensor;

void check_asset(const Tensor& joints, const Tensor& parents, const std::string& file, const std::string& place) {
  if (joints.dim() != 2 || joints.size(1) != 3 || !joints.is_floating_point()) {
    throw InputError(file, place, "joints must be floating-point values of shape [J, 3]");
  }
  if (joints.size(0) == 0) throw InputError(file, place, "the skeleton has no joints");
  if (parents.dim() != 1 || parents.size(0) != joints.size(0) || parents.is_floating_point()) {
    throw InputError(file, place, "parents must be " + std::to_string(joints.size(0)) + " integers, one per joint");
  }
  if (!torch::isfinite(joints).all().item<bool>()) throw InputError(file, place, "a joint position is not finite");
}

}  // namespace

SkeletonBatch SkeletonBatch::from_lists(const std::vector<Tensor>& joints, const std::vector<Tensor>& parents,
                                        const std::string& file) {
  if (joints.empty() || joints.size() != parents.size()) {
    throw InputError(file, "",
                     "a batch needs one list of parents per skeleton: " + std::to_string(joints.size()) +
                         " skeletons, " + std::to_string(parents.size()) + " lists of parents");
  }
  std::vector<std::int64_t> lengths, parent_rows, anchor_rows;
  std::int64_t total = 0;
  for (const Tensor& asset : joints) total += asset.dim() > 0 ? asset.size(0) : 0;
  for (std::size_t i = 0; i < joints.size(); ++i) {
    const std::string place = "skeleton " + std::to_string(i);
    check_asset(joints[i], parents[i], file, place);
    const std::int64_t count = joints[i].size(0), offset = static_cast<std::int64_t>(parent_rows.size());
    const Tensor indices = parents[i].to(torch::kCPU, torch::kInt64).contiguous();
    for (std::int64_t j = 0; j < count; ++j) {
      const std::int64_t parent = indices.data_ptr<std::int64_t>()[j];
      if (parent < -1 || parent >= count) {
        throw InputError(file, place,
                         "joint " + std::to_string(j) + " has parent " + std::to_string(parent) + ", but there are " +
                             std::to_string(count) + " joints");
      }
      parent_rows.push_back(parent < 0 ? total : offset + parent);
      anchor_rows.push_back(parent < 0 ? offset : offset + parent);
    }
    lengths.push_back(count);
  }
  SkeletonBatch batch;
  batch.joints = joints.size() == 1 ? joints[0] : torch::cat(joints, 0);
  const auto options = torch::TensorOptions().dtype(torch::kInt64);
  batch.parent_rows = torch::tensor(parent_rows, options).to(batch.joints.device());
  batch.anchor_rows = torch::tensor(anchor_rows, options).to(batch.joints.device());
  batch.items = nn::Ragged(lengths);
  return batch;
}

SkeletonBatch SkeletonBatch::to(torch::Device device) const {
  SkeletonBatch moved = *this;
  moved.joints = joints.to(device);
  moved.parent_rows = parent_rows.to(device);
  moved.anchor_rows = anchor_rows.to(device);
  return moved;
}

}  // namespace anigen::models
