#pragma once
#include <cstdint>
#include <string>
#include <unordered_map>
#include <vector>

#include "anigen/io/arrays/torch_tree.h"
#include "anigen/io/arrays/zip_archive.h"
#include "anigen/io/ndarray.h"

namespace anigen::io {

/// The data/<key> members of a torch archive. Tensors are views into them: several may share one storage (training
/// checkpoints keep all trainable parameters in one flat buffer), each storage is read once and freed after its last
/// use.
class TorchStorages {
 public:
  TorchStorages(const ZipReader& archive, std::string folder, bool big_endian);

  /// Contiguous copies in the order of the leaves. @throws InputError for views beyond their storage and storages
  /// whose length disagrees with the pickle
  NamedArrays materialize(const std::vector<TorchLeaf>& leaves);

 private:
  NdArray tensor(const TorchLeaf& leaf);
  std::string load(const pickle::Value& storage) const;
  [[noreturn]] void fail(const TorchLeaf& leaf, const std::string& problem) const;

  const ZipReader& archive_;
  std::string folder_;
  bool big_endian_;
  struct Shared {
    std::string bytes;
    bool loaded = false;
    std::size_t uses = 0;
    Dtype dtype = Dtype::kF32;
    std::int64_t count = 0;
  };
  std::unordered_map<std::string, Shared> shared_;
  std::uint64_t budget_;  // stride 0 lets a tiny storage stand for a huge tensor
};

}  // namespace anigen::io
