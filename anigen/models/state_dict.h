#pragma once
#include <string>
#include <vector>

#include "anigen/io/ndarray.h"
#include "anigen/nn/torch.h"

namespace anigen::models {

/// One parameter or buffer of a model under its state-dict key (the path of module names joined by '.').
struct StateEntry {
  std::string key;
  torch::Tensor tensor;  ///< shares storage with the model
  bool is_buffer = false;
};

/// Parameters and buffers in the order of registration: a module's own parameters, its own buffers, then its children
/// one after another. This is the order of published state dicts.
std::vector<StateEntry> state_entries(const torch::nn::Module& module);

/// Copies of all entries, in that order and in their run-time dtype.
io::NamedArrays state_dict(const torch::nn::Module& module);

enum class LoadMode {
  kStrict,    ///< every key must match
  kNonStrict  ///< keys that only one side has are left alone, as the published loader does
};

struct LoadReport {
  std::vector<std::string> missing;     ///< keys of the model that the arrays lack
  std::vector<std::string> unexpected;  ///< keys of the arrays that the model lacks
};

/// Copies the arrays into the model, converted to its run-time dtype (fp32 → fp16 rounds to nearest). Nothing is
/// written before everything was checked.
/// @param source file name for messages
/// @throws InputError naming the key and both shapes on a shape mismatch, in either mode; in strict mode also naming
///   missing and unexpected keys
LoadReport load_state_dict(torch::nn::Module& module, const io::NamedArrays& arrays, LoadMode mode,
                           const std::string& source = "");
/// The same, giving back each array's bytes as soon as they are in the model: a file of gigabytes then needs its size
/// once, since memory that a model was given without initial values is not used before it is written.
LoadReport load_state_dict(torch::nn::Module& module, io::NamedArrays&& arrays, LoadMode mode,
                           const std::string& source = "");

/// The dtype that each entry has in the published system: fp16 for the parameters of Linear and convolution layers
/// below one of the named modules ("skin_decoder.blocks_skin") and for parameters that are named themselves, fp32 for
/// every other floating-point entry. Differs from the tensor's own dtype where we compute in fp32, as on a CPU
/// (reference autoencoders.md, 0.4 and appendix A).
/// @return one per entry of state_entries, in its order
std::vector<torch::Dtype> published_dtypes(const torch::nn::Module& module,
                                           const std::vector<std::string>& half_precision_modules);

}  // namespace anigen::models
