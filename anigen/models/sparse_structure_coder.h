#pragma once
#include "anigen/models/sparse_structure_options.h"
#include "anigen/models/stream_coder.h"

namespace anigen::models {

/// What encoder and decoder of the sparse structure do alike. Both have the modules `blocks` and `middle_block`, and
/// the same with `_skl`, which are the torso (reference autoencoders.md, 2.1, fp16 torso).
class SparseStructureCoder : public StreamCoder {
 protected:
  explicit SparseStructureCoder(const SparseStructureCoderOptions& options);
};

}  // namespace anigen::models
