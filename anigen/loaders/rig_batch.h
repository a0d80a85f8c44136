#pragma once
#include <torch/torch.h>

#include <memory>
#include <vector>

#include "anigen/geometry/nearest_surface.h"
#include "anigen/loaders/files/rig_arrays.h"

namespace anigen::loaders {

/// The rigged meshes of a batch, one entry per asset: they stay lists, since their sizes differ. World frame.
struct RigBatch {
  std::vector<torch::Tensor> joints;    ///< [J, 3] fp32
  std::vector<torch::Tensor> parents;   ///< [J] int32, -1 for a root
  std::vector<torch::Tensor> skin;      ///< [V, J] fp32
  std::vector<torch::Tensor> vertices;  ///< [V, 3] fp32
  std::vector<torch::Tensor> faces;     ///< [F, 3], int32 where the file has int32, else int64
  /// With `load_cubvh`: the nearest-surface solver of each mesh, shared between batches; otherwise empty.
  std::vector<std::shared_ptr<const geometry::NearestSurface>> surfaces;

  void append(const RigArrays& rig);
};

}  // namespace anigen::loaders
