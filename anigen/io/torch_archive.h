#pragma once
#include <filesystem>
#include <string>

#include "anigen/core/json.h"
#include "anigen/io/ndarray.h"

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

}  // namespace anigen::io
