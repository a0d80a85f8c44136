#include "anigen/loaders/rig_batch.h"

#include <algorithm>

#include "anigen/loaders/ragged_voxels.h"

namespace anigen::loaders {
namespace {

torch::Tensor points_tensor(const std::vector<Eigen::Vector3f>& points) {
  torch::Tensor tensor = torch::empty({static_cast<std::int64_t>(points.size()), 3});
  float* out = tensor.data_ptr<float>();
  for (const Eigen::Vector3f& point : points) out = std::copy_n(point.data(), 3, out);
  return tensor;
}

template <typename T>
torch::Tensor faces_tensor(const std::vector<Triangle>& faces, torch::Dtype dtype) {
  torch::Tensor tensor = torch::empty({static_cast<std::int64_t>(faces.size()), 3}, dtype);
  T* out = tensor.data_ptr<T>();
  for (const Triangle& face : faces) out = std::copy(face.begin(), face.end(), out);
  return tensor;
}

}  // namespace

void RigBatch::append(const RigArrays& rig) {
  const auto joint_count = static_cast<std::int64_t>(rig.joints.size());
  joints.push_back(points_tensor(rig.joints));
  torch::Tensor links = torch::empty({joint_count}, torch::kInt32);
  std::copy(rig.parents.begin(), rig.parents.end(), links.data_ptr<std::int32_t>());
  parents.push_back(links);
  skin.push_back(tensor_of(rig.skin, {static_cast<std::int64_t>(rig.vertices.size()), joint_count}));
  vertices.push_back(points_tensor(rig.vertices));
  faces.push_back(rig.face_dtype == io::Dtype::kI32 ? faces_tensor<std::int32_t>(rig.faces, torch::kInt32)
                                                    : faces_tensor<std::int64_t>(rig.faces, torch::kInt64));
}

}  // namespace anigen::loaders
