#include "anigen/models/sparse_structure_coder.h"

#include "anigen/core/error.h"
#include "anigen/models/freezing.h"
#include "anigen/nn/init.h"

namespace anigen::models {
namespace {

std::vector<std::string> torso_names() { return {"blocks", "blocks_skl", "middle_block", "middle_block_skl"}; }

}  // namespace

void SparseStructureCoder::apply_freezing() { freeze_modules(*this, shared_options_.modules_to_freeze); }

std::vector<std::string> SparseStructureCoder::half_precision_modules() const {
  return shared_options_.use_fp16 ? torso_names() : std::vector<std::string>();
}

void SparseStructureCoder::convert_to_fp16() {
  if (!parameters().front().is_cuda()) {
    throw NotSupportedError("", "", "fp16 on a CPU; move the model to a GPU first");
  }
  if (shared_options_.use_fp16) set_torso_dtype(torch::kHalf);
}

void SparseStructureCoder::set_torso_dtype(torch::Dtype dtype) {
  const auto children = named_children();
  for (const std::string& name : torso_names()) nn::cast_linears(*children[name], dtype);
}

}  // namespace anigen::models
