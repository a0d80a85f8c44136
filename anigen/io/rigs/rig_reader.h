#pragma once
#include <filesystem>
#include <memory>
#include <mutex>
#include <string>

#include "anigen/io/arrays/ndarray.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::io {

/// sha256 of the arrays, sorted by name: of each its name, dtype, shape and bytes. So it does not matter in which file
/// or in which order they are.
std::string content_id(NamedArrays arrays);

/// Reads listed rigs as assets: mesh, one skeleton with parents first, weights; Z up. The shard that was read last
/// stays open, so samples are best read in the order of the listing; several threads may read at once.
///
/// Memory: shards keep their arrays on disk until a sample is read.
class RigReader {
 public:
  /// @return validate() finds nothing wrong with it; notes as of read_gltf(), among them "zero_weights" and
  /// "duplicate_joint_names" with their counts in front
  /// @throws InputError naming the file, also when mesh, faces, skeleton or weights are missing; NotSupportedError
  ImportedAsset read(const RigEntry& entry) const;

  /// The sha256 of the content, wherever it lies: of the bytes of .glb, .fbx and .dae; of a .gltf followed by its
  /// external buffers; of a text rig followed by its .obj; of the arrays of a sample (names, dtypes, shapes, data,
  /// sorted by name) for shards, .npz and datasets.
  /// @throws InputError when something cannot be read
  std::string content_id(const RigEntry& entry) const;

 private:
  std::shared_ptr<const ShapeSource> shard(const RigEntry& entry) const;

  mutable std::mutex mutex_;
  mutable std::filesystem::path open_file_;
  mutable std::shared_ptr<const ShapeSource> open_shard_;
};

/// Digest of the names and contents of pictures and materials that lie beside a glTF, FBX or COLLADA file and are
/// there: what content_id() leaves out. Empty where there is none.
std::string pictures_id(const RigEntry& entry);

}  // namespace anigen::io
