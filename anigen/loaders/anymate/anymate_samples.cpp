#include "anigen/loaders/anymate/anymate_samples.h"

#include <algorithm>

#include "anigen/core/error.h"
#include "anigen/core/random.h"
#include "anigen/geometry/surface_sampling.h"
#include "anigen/loaders/anymate/anymate_mesh.h"
#include "anigen/loaders/anymate/bone_layout.h"
#include "anigen/models/tensor_arrays.h"

namespace anigen::loaders {
namespace {

using models::anymate::AnymateSample;
using torch::Tensor;

Tensor rows_of(const std::vector<Eigen::Vector3f>& points) {
  Tensor tensor = torch::empty({static_cast<std::int64_t>(points.size()), 3});
  float* out = tensor.data_ptr<float>();
  for (const Eigen::Vector3f& point : points) out = std::copy_n(point.data(), 3, out);
  return tensor;
}

std::vector<Eigen::Vector3f> in_frame(const std::vector<Eigen::Vector3f>& points, const AnymateFrame& frame) {
  std::vector<Eigen::Vector3f> moved;
  for (const Eigen::Vector3f& point : points) moved.emplace_back(frame.into(point.cast<double>()).cast<float>());
  return moved;
}

std::vector<bool> used_joints(const RiggedItem& item) {
  std::vector<bool> used(item.joints.size(), false);
  for (const Influence& influence : item.skin.influences) used[static_cast<std::size_t>(influence.joint)] = true;
  return used;
}

void put_weights(const SkinWeights& skin, const std::vector<int>& bone_of, AnymateSample& sample) {
  const auto rows = static_cast<std::int64_t>(skin.rows());
  const auto most = static_cast<std::int64_t>(std::max<std::size_t>(skin.largest_row(), 1));
  sample.skins_index = torch::full({rows, most}, -1, torch::kInt64);
  sample.skins_weight = torch::zeros({rows, most});
  auto* index = sample.skins_index.data_ptr<std::int64_t>();
  auto* weight = sample.skins_weight.data_ptr<float>();
  for (std::size_t row = 0; row < skin.rows(); ++row, index += most, weight += most) {
    for (std::size_t i = 0; i < skin.row_size(row); ++i) {
      index[i] = bone_of[static_cast<std::size_t>(skin.row(row)[i].joint)];
      weight[i] = skin.row(row)[i].weight;
    }
  }
}

AnymateSample converted(const RiggedItem& item, const AnymateConversion& options, std::vector<int>* bone_of) {
  const AnymateMesh mesh = anymate_mesh(item.vertices, item.faces);
  Rng rng(options.seed, "anymate points " + item.id);
  const auto points = geometry::sample_surface(mesh.vertices, mesh.faces, options.points, rng);
  const SkinWeights skin = geometry::interpolate_skin(item.skin, item.faces, points);
  std::vector<Eigen::Vector3f> positions;
  for (const geometry::SurfacePoint& point : points) {
    positions.emplace_back(geometry::position(point, mesh.vertices, mesh.faces).cast<float>());
  }
  const BoneLayout layout =
      lay_out_bones(in_frame(item.joints, mesh.frame), item.parents, used_joints(item), positions, skin);
  AnymateSample sample;
  sample.name = item.id;
  sample.points_cloud = surface_features(mesh, points);
  sample.joints = rows_of(layout.joints);
  sample.conns = torch::tensor(std::vector<std::int64_t>(layout.conns.begin(), layout.conns.end()));
  sample.bones = torch::cat({rows_of(layout.heads), rows_of(layout.tails)}, 1);
  put_weights(skin, layout.bone_of, sample);
  if (options.cells) sample.vox = solid_cells(mesh);
  if (bone_of != nullptr) *bone_of = layout.bone_of;
  return sample;
}

}  // namespace

AnymateSample convert_rig(const RiggedItem& item, const AnymateConversion& options, std::vector<int>* bone_of) {
  try {
    return converted(item, options, bone_of);
  } catch (const InputError& error) {
    if (!error.file().empty()) throw;
    throw InputError(item.id, error.place(), error.problem());
  }
}

AnymateSample read_anymate_sample(const io::NamedArrays& arrays, const std::string& name, const std::string& file) {
  const auto place = [&](const char* key) { return "sample " + name + ", " + key; };
  const auto read = [&](const char* key, const std::vector<std::int64_t>& shape, bool whole) {
    const io::NdArray* array = io::find(arrays, key);
    if (array == nullptr) throw InputError(file, place(key), "is missing");
    const Tensor tensor = models::to_tensor(*array);
    bool fits = tensor.dim() == static_cast<std::int64_t>(shape.size());
    for (std::size_t axis = 0; fits && axis < shape.size(); ++axis) {
      fits = shape[axis] < 0 || tensor.size(static_cast<std::int64_t>(axis)) == shape[axis];
    }
    if (!fits) throw InputError(file, place(key), "has another shape than Anymate's files");
    if (tensor.is_floating_point() == whole)
      throw InputError(file, place(key), "has another type than Anymate's files");
    if (!whole && !tensor.isfinite().all().item<bool>()) throw InputError(file, place(key), "is not finite");
    return whole ? tensor.to(torch::kInt64) : tensor.to(torch::kFloat32);
  };
  AnymateSample sample;
  sample.name = name;
  sample.points_cloud = read("pc", {-1, 6}, false);
  sample.joints = read("joints", {-1, 3}, false);
  sample.conns = read("conns", {sample.joints.size(0)}, true);
  sample.bones = read("bones", {-1, 6}, false);
  if (io::find(arrays, "skins_index") != nullptr) {
    sample.skins_index = read("skins_index", {sample.points_cloud.size(0), -1}, true);
    sample.skins_weight = read("skins_weight", {sample.points_cloud.size(0), sample.skins_index.size(1)}, false);
  }
  if (io::find(arrays, "vox") != nullptr) sample.vox = read("vox", {-1, 3}, true);
  return sample;
}

}  // namespace anigen::loaders
