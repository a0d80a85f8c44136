#pragma once
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::io {

/// Writes many rigged shapes into one file, one after the other, so that none stays in memory. The file appears with
/// finish(). Equal shapes give equal bytes.
class ShardWriter {
 public:
  virtual ~ShardWriter() = default;
  /// @param name of the sample, which readers call it by
  /// @throws InputError when the shape has no faces, joints or weights, or when the format cannot hold it
  virtual void add(const RiggedShape& shape, const std::string& name) = 0;
  /// @throws Error unless as many shapes came as were announced
  virtual void finish() = 0;
};

/// By extension:
///   .npz  Articulation-XL 2.0 (docs/reference/riggers.md, 3): box centred, largest coordinate 0.5, Z up; `pc_w_norm`
///         are 8,192 points of the surface itself, where the published ones are of a watertight copy
///   .pt   Anymate (docs/reference/anymate.md, 1.2 to 1.5): longest side 2, Y up. Every joint is a bone, those without
///         weights too; leaves, and joints with several children, get a tail joint, which the file's layout has and
///         the shape had not. `vox` are the cells that the surface meets. At most 127 bones
/// @param count shapes that will be added
/// @throws NotSupportedError for another extension
std::unique_ptr<ShardWriter> open_shard_writer(const std::filesystem::path& file, std::size_t count);

/// As shape_from_anymate() reads it: the arrays of one sample; its name is not among them. @throws InputError
NamedArrays anymate_sample(const RiggedShape& shape);

}  // namespace anigen::io
