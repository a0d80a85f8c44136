#include "anigen/loaders/files/voxel_files.h"

#include "anigen/core/error.h"
#include "anigen/io/npz.h"
#include "anigen/io/ply.h"
#include "anigen/loaders/files/npz_arrays.h"

namespace anigen::loaders {
namespace {

constexpr std::int64_t kGrid = 64;
constexpr std::size_t kMostVoxels = static_cast<std::size_t>(kGrid * kGrid * kGrid);
constexpr std::size_t kMostNumbers = std::size_t{1} << 29;

std::vector<geometry::Voxel> distinct_voxels(const io::NamedArrays& arrays, const std::string& name,
                                             const std::string& file) {
  const std::vector<std::int64_t> flat = whole_numbers(arrays, name, file);
  std::vector<geometry::Voxel> voxels(flat.size() / 3);
  std::vector<bool> seen(kMostVoxels, false);
  for (std::size_t i = 0; i < flat.size(); ++i) {
    if (flat[i] < 0 || flat[i] >= kGrid) {
      throw InputError(file, place_of(name, named(arrays, name).shape, i),
                       "is " + std::to_string(flat[i]) + ", outside the grid of " + std::to_string(kGrid) + "³ voxels");
    }
    voxels[i / 3][i % 3] = static_cast<std::int32_t>(flat[i]);
    if (i % 3 != 2) continue;
    const auto cell = static_cast<std::size_t>((flat[i - 2] * kGrid + flat[i - 1]) * kGrid + flat[i]);
    if (seen[cell]) throw InputError(file, place_of(name, {-1}, i / 3), "this voxel is there twice");
    seen[cell] = true;
  }
  return voxels;
}

}  // namespace

std::vector<geometry::Voxel> read_voxel_rows(const std::filesystem::path& path, int resolution) {
  const Mesh points = io::read_ply(path);
  if (points.vertices.empty()) throw InputError(path.string(), "vertex", "there are no voxels");
  std::vector<geometry::Voxel> voxels;
  voxels.reserve(points.vertices.size());
  for (std::size_t i = 0; i < points.vertices.size(); ++i) {
    const Eigen::Vector3f& p = points.vertices[i];
    geometry::Voxel voxel{};
    for (int axis = 0; axis < 3; ++axis) {
      // In single precision and towards zero, as published: a little below −½ still is voxel 0.
      const float place = (p[axis] + 0.5f) * static_cast<float>(resolution);
      if (!(place > -1.0f) || !(place < static_cast<float>(resolution))) {
        throw InputError(path.string(), "vertex " + std::to_string(i),
                         "coordinate " + std::to_string(p[axis]) + " is outside the grid from -0.5 to 0.5");
      }
      voxel[static_cast<std::size_t>(axis)] = static_cast<std::int32_t>(place);
    }
    voxels.push_back(voxel);
  }
  return voxels;
}

VoxelRows read_voxel_arrays(const std::filesystem::path& path, const std::string& coords, const std::string& feats) {
  const std::string file = path.string();
  const io::NamedArrays arrays =
      read_arrays(path, {{coords, {-1, 3}, 3 * kMostVoxels}, {feats, {-1, -1}, kMostNumbers}});
  VoxelRows rows;
  rows.coords = distinct_voxels(arrays, coords, file);
  const std::vector<std::int64_t>& shape = named(arrays, feats).shape;
  if (rows.coords.empty()) throw InputError(file, coords, "there are no voxels");
  if (shape[0] != static_cast<std::int64_t>(rows.coords.size())) {
    throw InputError(file, feats,
                     "has " + std::to_string(shape[0]) + " rows for the " + std::to_string(rows.coords.size()) +
                         " voxels of '" + coords + "'");
  }
  rows.channels = static_cast<std::size_t>(shape[1]);
  rows.feats = finite_numbers(arrays, feats, file);
  return rows;
}

VoxelRows read_voxel_features(const std::filesystem::path& path) {
  return read_voxel_arrays(path, "indices", "patchtokens");
}

std::uint64_t count_rows(const std::filesystem::path& path, const std::string& name) {
  const io::NamedArrays headers = io::read_npz_headers(path);
  const io::NdArray* array = io::find(headers, name);
  if (array == nullptr || array->shape.empty()) throw InputError(path.string(), name, "no such array");
  return static_cast<std::uint64_t>(array->shape.front());
}

std::filesystem::path surface_voxel_path(const AssetId& asset) { return asset.root / "voxels" / (asset.id + ".ply"); }

std::filesystem::path skeleton_voxel_path(const AssetId& asset) {
  return asset.root / "voxels" / (asset.id + "_skeleton.ply");
}

}  // namespace anigen::loaders
