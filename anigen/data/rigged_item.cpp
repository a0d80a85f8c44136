#include "anigen/data/rigged_item.h"

#include <algorithm>
#include <queue>

#include "anigen/data/voxel_files.h"

namespace anigen::data {

std::size_t RiggedItem::bytes() const {
  return sizeof(*this) + joints.size() * (sizeof(joints[0]) + sizeof(int)) + vertices.size() * sizeof(vertices[0]) +
         faces.size() * sizeof(Triangle) + skin.offsets.size() * sizeof(std::size_t) +
         skin.influences.size() * sizeof(Influence);
}

std::vector<int> parents_first_order(const std::vector<int>& parents, const std::string& file) {
  const int count = static_cast<int>(parents.size());
  std::vector<std::vector<int>> children(parents.size());
  std::priority_queue<int, std::vector<int>, std::greater<int>> open;
  for (int j = 0; j < count; ++j) {
    const int parent = parents[static_cast<std::size_t>(j)];
    if (parent >= count || parent < -1 || parent == j) {
      throw InputError(file, "parents[" + std::to_string(j) + "]",
                       "is " + std::to_string(parent) + " among " + std::to_string(count) + " joints");
    }
    if (parent < 0)
      open.push(j);
    else
      children[static_cast<std::size_t>(parent)].push_back(j);
  }
  std::vector<int> order;
  while (!open.empty()) {
    order.push_back(open.top());
    open.pop();
    for (const int child : children[static_cast<std::size_t>(order.back())]) open.push(child);
  }
  if (order.size() != parents.size()) {
    throw InputError(file, "parents",
                     std::to_string(parents.size() - order.size()) + " joints are on or below a cycle");
  }
  return order;
}

RiggedItem read_rigged_item(const AssetId& asset, std::size_t max_joints) {
  RigArrays arrays = read_rig_arrays(asset, max_joints);
  RiggedItem item;
  item.id = asset.id;
  item.skin = from_dense(arrays.skin, arrays.vertices.size(), arrays.joints.size(), 0.0f, &item.unweighted);
  item.joints = std::move(arrays.joints);
  item.parents = std::move(arrays.parents);
  item.vertices = std::move(arrays.vertices);
  item.faces = std::move(arrays.faces);
  return item;
}

torch::Tensor points_tensor(const std::vector<Eigen::Vector3f>& points) {
  torch::Tensor tensor = torch::empty({static_cast<std::int64_t>(points.size()), 3});
  float* out = tensor.data_ptr<float>();
  for (const Eigen::Vector3f& point : points) out = std::copy_n(point.data(), 3, out);
  return tensor;
}

namespace {

template <typename T>
torch::Tensor faces_tensor(const std::vector<Triangle>& faces, torch::Dtype dtype) {
  torch::Tensor tensor = torch::empty({static_cast<std::int64_t>(faces.size()), 3}, dtype);
  T* out = tensor.data_ptr<T>();
  for (const Triangle& face : faces) out = std::copy(face.begin(), face.end(), out);
  return tensor;
}

constexpr std::uintmax_t kBytesPerFace = 300, kBytesPerVertex = 24;  // of a BVH with its copy of the mesh, about

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

std::shared_ptr<const geometry::NearestSurface> SurfaceCache::of(std::size_t asset, const RigArrays& rig) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (const auto found = places_.find(asset); found != places_.end()) {
      entries_.splice(entries_.begin(), entries_, found->second);
      return found->second->surface;
    }
  }
  auto surface = std::make_shared<const geometry::NearestSurface>(rig.vertices, rig.faces);
  const std::uintmax_t bytes = kBytesPerFace * rig.faces.size() + kBytesPerVertex * rig.vertices.size();
  const std::lock_guard<std::mutex> lock(mutex_);
  // Another thread may have built the same one meanwhile.
  if (bytes > budget_ || places_.count(asset) > 0) return surface;
  while (used_ + bytes > budget_) {
    used_ -= entries_.back().bytes;
    places_.erase(entries_.back().asset);
    entries_.pop_back();
  }
  entries_.push_front({asset, bytes, surface});
  places_[asset] = entries_.begin();
  used_ += bytes;
  return surface;
}

}  // namespace anigen::data
