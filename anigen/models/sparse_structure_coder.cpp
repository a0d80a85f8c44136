#include "anigen/models/sparse_structure_coder.h"

namespace anigen::models {
namespace {

StreamCoder::Parts sparse_structure_parts(const SparseStructureCoderOptions& options) {
  StreamCoder::Parts parts;
  parts.torso = {"blocks", "blocks_skl", "middle_block", "middle_block_skl"};
  parts.use_fp16 = options.use_fp16;
  parts.to_freeze = options.modules_to_freeze;
  return parts;
}

}  // namespace

SparseStructureCoder::SparseStructureCoder(const SparseStructureCoderOptions& options)
    : StreamCoder(sparse_structure_parts(options)) {}

}  // namespace anigen::models
