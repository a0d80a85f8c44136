#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <unordered_map>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/io/arrays/ndarray.h"
#include "anigen/io/arrays/npy.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/arrays/pickle.h"

namespace anigen::io {

/// Reads the tensors of a file written by torch.save (zip container): every tensor reachable through dicts, lists
/// and tuples, keyed by its path joined with '.', for example "optimizer.state.0.exp_avg"; a plain state dict
/// therefore yields its own keys. Storages shared by several tensors, offsets and strides are honoured, dtypes may
/// differ per tensor, CUDA tags are ignored, numbers become scalars (bool / int64 / float64), numpy arrays are kept;
/// strings, None, devices and dtypes are left out. Only the small set of pickle instructions and the constructors that
/// state dicts use are executed; anything else is refused by name.
/// @throws InputError naming file, member and byte; NotSupportedError for files from before PyTorch 1.6 (not zip)
NamedArrays read_torch_archive(const std::filesystem::path& path);

/// A checkpoint that torch.save wrote with more in it than weights.
struct TorchCheckpoint {
  NamedArrays state;  ///< what is below "state_dict" by its keys there; without that key everything, as above
  Json config;        ///< what is below the key asked for, null when it is not there
};

/// Reads nothing but these two: the state of an optimiser beside them costs no memory.
/// @param config_key of the file's dict, "model_config" say: of its value None, booleans, numbers, texts, lists, tuples
///   and dicts are kept, whatever else is in there becomes null @throws as read_torch_archive()
TorchCheckpoint read_torch_checkpoint(const std::filesystem::path& path, const std::string& config_key);

/// A state dict from `.pt`/`.pth` or `.safetensors` by extension. When the first key starts with "module." those
/// seven characters are dropped from every key (reference flows-and-pipeline.md, section 6.3).
NamedArrays read_state_dict(const std::filesystem::path& path);

/// The tensors whose keys begin with `prefix`, under their keys without it; others are not read, so that a part of a
/// large model costs no more memory than itself. `.safetensors`, or whatever else torch.save wrote (`.pt`, `.pth`,
/// `.ckpt`, `.bin`), there below "state_dict" where the file has one. @throws as read_torch_archive()
NamedArrays read_state_below(const std::filesystem::path& path, const std::string& prefix);

/// Something with numbers in it that a torch pickle holds, under its path joined with '.'.
struct TorchLeaf {
  std::string name;
  const pickle::Value* value;  ///< a tensor, a numpy array, or a bool, int or float
};

/// Walks dicts, lists and tuples in order. Strings, None, devices and dtypes are left out.
/// @throws InputError for cycles, sharing that explodes, and two values of one path
std::vector<TorchLeaf> torch_leaves(const pickle::Value& root, const NpyPlace& place);

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
