#pragma once
#include <string>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::models::anymate {

using torch::Tensor;

/// One sample of Anymate's data, as its files hold it (reference anymate-baselines.md, 1.2), in its frame: longest side
/// from -1 to 1, Y up. What is undefined is left out of the batch; joints and bones must be there.
struct AnymateSample {
  std::string name;     ///< for messages
  Tensor points_cloud;  ///< `pc` [N, 6] positions and face normals
  Tensor joints;        ///< [J, 3]
  Tensor conns;         ///< [J] integers: the parent of each joint, a root itself
  Tensor bones;         ///< [K, 6] head and tail
  Tensor skins_index;   ///< [N, m] integers: bones that hold a point, -1 for none
  Tensor skins_weight;  ///< [N, m] their weights
  Tensor vox;           ///< [V, 3] integers: occupied cells
};

struct CollateOptions {
  std::int64_t max_joints = 96, max_bones = 64;  ///< rows that joints and bones are padded to, with -3
};

/// Samples as tensors with an axis of items (reference anymate-baselines.md, 1.6). A tensor is undefined when the
/// samples do not have what it is made of.
struct AnymateBatch {
  std::vector<std::string> names;
  Tensor points_cloud;                   ///< [B, N, 6] fp32
  Tensor joints;                         ///< [B, max_joints, 3] fp32
  std::vector<std::int64_t> joints_num;  ///< J of each item
  Tensor joints_mask;                    ///< [B, Jmax] bool
  Tensor conns;                          ///< [B, max_joints, Jmax] fp32: one at [child, parent]
  Tensor bones;                          ///< [B, max_bones, 6] fp32
  std::vector<std::int64_t> bones_num;   ///< K of each item
  Tensor bones_mask;                     ///< [B, Kmax] bool
  Tensor skins;                          ///< [B, N, Kmax] fp64, as released
  std::vector<Tensor> vox;               ///< of each item
  Tensor joints_repeat;                  ///< [B, n, 3] fp32, of collate_diffusion only
};

/// For all tasks but diffusion. @throws InputError naming the sample: nothing to collate, shapes, more joints or bones
///   than rows, indices of joints or bones that do not exist, something that only some samples have
AnymateBatch collate(const std::vector<AnymateSample>& samples, const CollateOptions& options = {});

/// For diffusion: positions alone, and `points` joints of each item, its own repeated in turn. No masks, connectivity
/// or skin. @throws InputError as collate
AnymateBatch collate_diffusion(const std::vector<AnymateSample>& samples, std::int64_t points = 128,
                               const CollateOptions& options = {});

}  // namespace anigen::models::anymate
