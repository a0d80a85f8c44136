#pragma once
#include <string>
#include <vector>

#include "anigen/models/sparse_structure_options.h"
#include "anigen/nn/torch.h"

namespace anigen::models {

/// What encoder and decoder of the sparse structure do alike: freezing and precision. Both have the modules `blocks`
/// and `middle_block`, and the same with `_skl`, which are the torso.
class SparseStructureCoder : public torch::nn::Module {
 public:
  /// Turns off gradients as modules_to_freeze says, whatever the two flags say (see freezing.h).
  void apply_freezing();
  /// Names of the modules whose linears and convolutions are fp16 in the published system (reference autoencoders.md,
  /// 2.1, fp16 torso); empty without use_fp16.
  std::vector<std::string> half_precision_modules() const;
  /// Converts those modules in place. @throws NotSupportedError when the model is not on a GPU
  void convert_to_fp16();
  /// Converts the torso of both streams to any type, whatever use_fp16 says.
  void set_torso_dtype(torch::Dtype dtype);

 protected:
  explicit SparseStructureCoder(const SparseStructureCoderOptions& options) : shared_options_(options) {}

 private:
  SparseStructureCoderOptions shared_options_;
};

}  // namespace anigen::models
