#pragma once
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/io/arrays/ndarray.h"
#include "anigen/nn/torch.h"

namespace anigen::train {

/// A file of pretrained weights that a published model with `use_pretrain_branch` begins from: `<name>.safetensors`,
/// else `<name>.pt`, below the folder of pretrained weights (docs/reference/training.md, 2.4).
struct PretrainedFile {
  std::string name;        ///< mostly the class name
  std::string key_prefix;  ///< only keys that begin with this; empty: all
};

/// Ours, in `trainer.args`: where pretrained weights are, and whether they are wanted.
struct WarmStartOptions {
  /// `pretrained_dir`; a relative path is relative to the working directory.
  std::filesystem::path pretrained_dir = "ckpts/pretrained_ckpts";
  /// `warm_start` is "published" and not "none". With "none" nothing is loaded and nothing is frozen: branches that the
  /// published run takes from TRELLIS are trained with the rest.
  bool enabled = true;

  static WarmStartOptions read(ConfigReader& trainer_args);
};

/// Copies what a file and a model have in common into the model, with a line in the log about the rest.
/// @param source file name for messages @return keys of the entries that were filled
/// @throws InputError when there is no such entry, or when a shape does not fit; the model is then untouched
std::set<std::string> load_matching(torch::nn::Module& model, const io::NamedArrays& arrays, const std::string& source);

/// Fills a model with initial values from the files that exist, non-strictly and in order (load_matching). A missing
/// file of a model without frozen parameters is a warning, as in the published trainer.
/// @param loaded keys that another file has already filled; values of these files replace them
/// @throws InputError when a frozen parameter was in no file: it would stay at its random start for ever; for a file
/// without any tensor of the model; for a shape that does not fit; for a damaged file
void load_pretrained(torch::nn::Module& model, const std::vector<PretrainedFile>& files,
                     const WarmStartOptions& options, std::set<std::string> loaded = {});

/// Makes the frozen parameters and the buffers of a replica share memory with those of the original, so that whatever
/// is loaded into the one is seen by the other. (Trainable parameters share ParameterBuffer::master.)
/// @throws Error when the models differ
void share_frozen_weights(const torch::nn::Module& original, torch::nn::Module& replica);

}  // namespace anigen::train
