#include "anigen/loaders/files/rig_arrays.h"

#include <cstdint>

#include "anigen/core/error.h"
#include "anigen/loaders/files/npz_arrays.h"
#include "anigen/loaders/rigged_item.h"

namespace anigen::loaders {
namespace {

constexpr std::size_t kMostPoints = std::size_t{1} << 24;

std::vector<Eigen::Vector3f> points(const io::NamedArrays& arrays, const char* name, const std::string& file) {
  const std::vector<float> flat = named(arrays, name).as<float>();
  std::vector<Eigen::Vector3f> result(flat.size() / 3);
  for (std::size_t i = 0; i < result.size(); ++i) {
    result[i] = {flat[3 * i], flat[3 * i + 1], flat[3 * i + 2]};
    if (!result[i].allFinite()) throw InputError(file, place_of(name, {-1}, i), "is not finite");
  }
  return result;
}

std::vector<Triangle> triangles(const io::NamedArrays& arrays, std::size_t vertices, const std::string& file) {
  const std::vector<std::int64_t> flat = whole_numbers(arrays, "faces", file);
  std::vector<Triangle> result(flat.size() / 3);
  for (std::size_t i = 0; i < flat.size(); ++i) {
    if (flat[i] < 0 || flat[i] >= static_cast<std::int64_t>(vertices)) {
      throw InputError(file, place_of("faces", {-1}, i / 3),
                       "vertex " + std::to_string(flat[i]) + " of " + std::to_string(vertices));
    }
    result[i / 3][i % 3] = static_cast<std::int32_t>(flat[i]);
  }
  return result;
}

std::vector<float> weights(const io::NamedArrays& arrays, const std::string& file) {
  std::vector<float> skin = finite_numbers(arrays, "skin", file);
  for (std::size_t i = 0; i < skin.size(); ++i) {
    if (skin[i] < 0.0f) {
      throw InputError(file, place_of("skin", named(arrays, "skin").shape, i),
                       "is " + std::to_string(skin[i]) + "; weights must not be negative");
    }
  }
  return skin;
}

}  // namespace

std::filesystem::path rig_path(const AssetId& asset) {
  return asset.root / "skeleton" / asset.id / "skeleton_voxelized.npz";
}

RigArrays read_rig_arrays(const AssetId& asset, std::size_t max_joints) {
  const std::filesystem::path path = rig_path(asset);
  const std::string file = path.string();
  const io::NamedArrays arrays = read_arrays(path, {{"joints", {-1, 3}, kMostPoints},
                                                    {"parents", {-1}, kMostPoints},
                                                    {"skin", {-1, -1}},
                                                    {"vertices", {-1, 3}, 3 * kMostPoints},
                                                    {"faces", {-1, 3}, 6 * kMostPoints}});
  RigArrays rig;
  rig.joints = points(arrays, "joints", file);
  const std::size_t joints = rig.joints.size();
  if (joints == 0 || joints > max_joints) {
    throw InputError(file, "joints",
                     std::to_string(joints) + " joints; between 1 and " + std::to_string(max_joints) + " are possible");
  }
  const std::vector<std::int64_t> parents = whole_numbers(arrays, "parents", file);
  if (parents.size() != joints) {
    throw InputError(file, "parents",
                     "has shape [" + std::to_string(parents.size()) + "] for " + std::to_string(joints) + " joints");
  }
  for (const std::int64_t parent : parents) {
    // Anything outside the joints stays outside when it is narrowed; the check of the tree below reports it.
    rig.parents.push_back(parent < -1 || parent > 1'000'000 ? 1'000'000 : static_cast<int>(parent));
  }
  parents_first_order(rig.parents, file);
  rig.vertices = points(arrays, "vertices", file);
  rig.faces = triangles(arrays, rig.vertices.size(), file);
  rig.face_dtype = named(arrays, "faces").dtype;
  if (rig.faces.empty()) throw InputError(file, "faces", "is empty");
  const std::vector<std::int64_t>& shape = named(arrays, "skin").shape;
  if (shape[0] != static_cast<std::int64_t>(rig.vertices.size()) || shape[1] != static_cast<std::int64_t>(joints)) {
    throw InputError(file, "skin",
                     "has shape [" + std::to_string(shape[0]) + ", " + std::to_string(shape[1]) + "], expected [" +
                         std::to_string(rig.vertices.size()) + ", " + std::to_string(joints) + "]");
  }
  rig.skin = weights(arrays, file);
  return rig;
}

}  // namespace anigen::loaders
