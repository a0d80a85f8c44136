#include "anigen/data/voxel_files.h"

#include <algorithm>
#include <array>
#include <set>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/data/latent_files.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/ply.h"

namespace anigen::data {

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

VoxelRows read_features_at(const std::filesystem::path& features, int resolution) {
  VoxelRows rows = read_voxel_arrays(features, "indices", "patchtokens");
  if (resolution == kStoredResolution) return rows;
  geometry::PooledVoxels pooled =
      geometry::pool_features(rows.coords, rows.feats, rows.channels, kStoredResolution / resolution);
  return {std::move(pooled.voxels), std::move(pooled.features), rows.channels};
}

std::vector<geometry::Voxel> read_voxels_at(const std::filesystem::path& voxels, int resolution) {
  const std::vector<geometry::Voxel> rows = read_voxel_rows(voxels, kStoredResolution);
  return resolution == kStoredResolution ? rows : geometry::pool_voxels(rows, kStoredResolution / resolution);
}

VoxelRows with_support_noise(const VoxelRows& rows, int resolution, const SupportNoise& noise,
                             std::size_t foot_channels, Rng& rng) {
  constexpr std::array<geometry::Voxel, 6> kFaces{
      {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}}};
  const double grow = rng.uniform(0.0, noise.grow), drop = rng.uniform(0.0, noise.drop);
  const float edge = static_cast<float>(kStoredResolution) / static_cast<float>(resolution);
  std::set<geometry::Voxel> taken(rows.coords.begin(), rows.coords.end());
  VoxelRows grown = rows;
  for (std::size_t i = 0; i < rows.coords.size(); ++i) {
    for (const geometry::Voxel& face : kFaces) {
      geometry::Voxel beside = rows.coords[i];
      for (std::size_t axis = 0; axis < 3; ++axis) beside[axis] += face[axis];
      const auto [low, high] = std::minmax_element(beside.begin(), beside.end());
      if (*low < 0 || *high >= resolution || taken.count(beside) > 0 || !rng.chance(grow)) continue;
      taken.insert(beside);
      grown.coords.push_back(beside);
      const auto from = static_cast<std::ptrdiff_t>(i * rows.channels);
      const auto to = static_cast<std::ptrdiff_t>(rows.channels);
      grown.feats.insert(grown.feats.end(), rows.feats.begin() + from, rows.feats.begin() + from + to);
      float* feature = grown.feats.data() + grown.feats.size() - rows.channels;
      for (std::size_t axis = 0; axis < foot_channels; ++axis) feature[axis] -= edge * static_cast<float>(face[axis]);
    }
  }
  VoxelRows kept;
  kept.channels = rows.channels;
  for (std::size_t i = 0; i < grown.coords.size(); ++i) {
    const bool last = kept.coords.empty() && i + 1 == grown.coords.size();
    if (rng.chance(drop) && !last) continue;
    kept.coords.push_back(grown.coords[i]);
    const auto from = static_cast<std::ptrdiff_t>(i * rows.channels), to = static_cast<std::ptrdiff_t>(rows.channels);
    kept.feats.insert(kept.feats.end(), grown.feats.begin() + from, grown.feats.begin() + from + to);
  }
  return kept;
}

torch::Tensor tensor_of(const std::vector<float>& values, torch::IntArrayRef shape) {
  torch::Tensor tensor = torch::empty(shape);
  TORCH_CHECK(tensor.numel() == static_cast<std::int64_t>(values.size()), "shape does not fit the numbers");
  std::copy(values.begin(), values.end(), tensor.data_ptr<float>());
  return tensor;
}

torch::Tensor stack(const std::vector<const std::vector<float>*>& values, std::vector<std::int64_t> shape,
                    const std::vector<std::string>& ids, const std::string& what) {
  std::int64_t each = 1;
  for (const std::int64_t size : shape) each *= size;
  shape.insert(shape.begin(), static_cast<std::int64_t>(values.size()));
  torch::Tensor tensor = torch::empty(shape);
  float* out = tensor.data_ptr<float>();
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (static_cast<std::int64_t>(values[i]->size()) != each)
      throw InputError(ids[i], what, "is of another shape than that of " + ids[0] + ", in the same batch");
    out = std::copy(values[i]->begin(), values[i]->end(), out);
  }
  return tensor;
}

RaggedVoxels collate_voxels(const std::vector<const VoxelRows*>& rows, const std::vector<std::string>& ids) {
  RaggedVoxels batch;
  std::int64_t total = 0;
  const std::size_t channels = rows.empty() ? 0 : rows.front()->channels;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i]->channels != channels) {
      throw InputError(ids[i], "channels",
                       std::to_string(rows[i]->channels) + " per voxel; " + ids[0] + ", in the same batch, has " +
                           std::to_string(channels));
    }
    batch.lengths.push_back(static_cast<std::int64_t>(rows[i]->coords.size()));
    total += batch.lengths.back();
  }
  batch.coords = torch::empty({total, 4}, torch::kInt32);
  batch.feats = torch::empty({total, static_cast<std::int64_t>(channels)});
  std::int32_t* coords = batch.coords.data_ptr<std::int32_t>();
  float* feats = batch.feats.data_ptr<float>();
  for (std::size_t i = 0; i < rows.size(); ++i) {
    for (const geometry::Voxel& voxel : rows[i]->coords) {
      *coords++ = static_cast<std::int32_t>(i);
      coords = std::copy(voxel.begin(), voxel.end(), coords);
    }
    feats = std::copy(rows[i]->feats.begin(), rows[i]->feats.end(), feats);
  }
  return batch;
}

}  // namespace anigen::data
