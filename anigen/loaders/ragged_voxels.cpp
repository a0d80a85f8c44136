#include "anigen/loaders/ragged_voxels.h"

#include <algorithm>

#include "anigen/core/error.h"

namespace anigen::loaders {

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
    if (static_cast<std::int64_t>(values[i]->size()) != each) {
      throw InputError(ids[i], what, "is of another shape than that of " + ids[0] + ", in the same batch");
    }
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

}  // namespace anigen::loaders
