#pragma once
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>

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

/// Takes the arrays of a file one after another.
using ArrayVisitor = std::function<void(const std::string& key, NdArray&& array)>;

/// A state dict from `.pt`/`.pth` or `.safetensors` by extension. When the first key starts with "module." those
/// seven characters are dropped from every key (docs/reference/flows.md, 6.1). Weights in eight bits come as fp32
/// (io/arrays/row_quantization.h). @throws as read_torch_archive()
NamedArrays read_state_dict(const std::filesystem::path& path);

/// read_state_dict() with one array in memory at a time, in the order of the file; of tensors that share a storage all
/// of that. @throws as read_state_dict(), damage of an array when it is its turn
void visit_state_dict(const std::filesystem::path& path, const ArrayVisitor& visit);

/// The tensors whose keys begin with `prefix`, under their keys without it; others are not read, so that a part of a
/// large model costs no more memory than itself. `.safetensors`, or whatever else torch.save wrote (`.pt`, `.pth`,
/// `.ckpt`, `.bin`), there below "state_dict" where the file has one. @throws as read_torch_archive()
NamedArrays read_state_below(const std::filesystem::path& path, const std::string& prefix);

/// A file that torch.save wrote, its pickle run and its tensors not yet read. Not for several threads at once.
class TorchFile {
 public:
  /// @throws as read_torch_archive()
  explicit TorchFile(const std::filesystem::path& path);

  const pickle::Value& root() const { return document_.root(); }
  NpyPlace place() const { return {archive_.file(), member_.name}; }
  /// Every tensor, numpy array, bool, int and float at or below a value, under its path joined with '.'; of those the
  /// ones whose path begins with `prefix`. @throws InputError for cycles, sharing that explodes, two values of one
  /// path, views beyond their storage and storages whose length disagrees with the pickle
  NamedArrays arrays(const pickle::Value& value, const std::string& prefix = {}) const;
  /// arrays() one after another. Storages are described and shared as they should be, or nothing is visited.
  void visit(const pickle::Value& value, const std::string& prefix, const ArrayVisitor& visitor) const;

 private:
  ZipReader archive_;
  const ZipMember& member_;
  pickle::Document document_;
};

/// The value of a text key; nullptr when there is none, or when `dict` is no dict.
const pickle::Value* find(const pickle::Value& dict, std::string_view key);

}  // namespace anigen::io
