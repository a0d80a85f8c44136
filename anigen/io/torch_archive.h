#pragma once
#include <filesystem>

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

/// A state dict from `.pt`/`.pth` or `.safetensors` by extension. When the first key starts with "module." those
/// seven characters are dropped from every key (reference flows-and-pipeline.md, section 6.3).
NamedArrays read_state_dict(const std::filesystem::path& path);

}  // namespace anigen::io
