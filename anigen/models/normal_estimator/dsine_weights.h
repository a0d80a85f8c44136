#pragma once
#include <filesystem>
#include <string>

#include "anigen/io/ndarray.h"
#include "anigen/models/normal_estimator/dsine.h"

namespace anigen::models {

/// Fills the network. Accepted are the arrays of the released file, whose state dict stands under `model` (then every
/// other key is left alone), and a bare state dict; either with or without `module.` before its keys, and with or
/// without the counters `num_batches_tracked`, which have no influence.
/// @param file for messages
/// @throws InputError naming the key: missing or unexpected keys, another shape (both named), values that are not
///   finite, whole numbers where weights belong; the network is then unchanged
void set_dsine_weights(Dsine& network, io::NamedArrays arrays, const std::string& file);

/// DSINE with the weights of a `.pt`, `.pth` or `.safetensors` file, on the CPU.
///
/// The released weights (`dsine.pt`, about 291 MB) are not part of this project and are not ours to pass on: users
/// bring their own copy. They are published for non-commercial research (Imperial College London's licence of DSINE),
/// and what is made with them should be treated the same way (reference normal-estimator.md, 1).
/// @throws InputError as set_dsine_weights, and for files that cannot be read
Dsine load_dsine(const std::filesystem::path& file);

}  // namespace anigen::models
