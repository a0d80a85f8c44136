#pragma once
#include <functional>
#include <string>
#include <vector>

#include "anigen/models/structured_latent_options.h"
#include "anigen/nn/linear.h"
#include "anigen/sparse/transformer_block.h"

namespace anigen::models {

/// One of something for each stream of the structured latents.
template <typename T>
struct PerStream {
  T geometry, skin, skeleton;
};

/// The three transformers that encoder and decoder have alike (reference autoencoders.md, 3.1): per stream an input
/// layer with the position embedding of the voxel indices, then blocks, in which skin and skeleton may attend to each
/// other and to the geometry as they were before the block. Not a module of its own, since the published keys lie
/// beside those of the model: `input_layer{,_skl,_skin}.*`, `blocks.{i}.*`, `blocks_skin.{i}.*`, `blocks_skl.{i}.*`,
/// which the constructor registers with it.
class StructuredLatentTorso {
 public:
  StructuredLatentTorso() = default;
  /// @param in_channels of the three inputs
  StructuredLatentTorso(torch::nn::Module& model, const StructuredLatentCoderOptions& options,
                        const PerStream<std::int64_t>& in_channels);

  /// @param x inputs; geometry and skin on the same support @return the same supports, torso widths, dtype of the
  /// blocks
  PerStream<sparse::SparseTensor> forward(const PerStream<sparse::SparseTensor>& x);

  /// Blocks keep only their inputs for the backward pass and run again in it (see recompute.h).
  void recompute_blocks(bool on) { recompute_ = on; }

  /// Names of the modules that are the torso, for StreamCoder.
  static std::vector<std::string> names() { return {"blocks", "blocks_skin", "blocks_skl"}; }

 private:
  using CrossBlocks = std::vector<sparse::SparseMultiContextBlock>;
  sparse::SparseTensor run(sparse::SparseMultiContextBlock block, const sparse::SparseTensor& x,
                           const std::vector<sparse::SparseTensor>& contexts) const;

  bool skin_from_geometry_ = false, skeleton_from_geometry_ = false, skin_and_skeleton_ = false;
  bool recompute_ = false;
  PerStream<nn::Linear> input_{nullptr, nullptr, nullptr};
  std::vector<sparse::SparseTransformerBlock> blocks_;
  CrossBlocks skin_blocks_, skeleton_blocks_;
};

/// part(x), which in training keeps nothing but x for the backward pass if `recompute` says so.
sparse::SparseTensor run_part(bool recompute, const sparse::SparseTensor& x,
                              const std::function<sparse::SparseTensor(const sparse::SparseTensor&)>& part);

/// Refuses features that do not fit before they become NaN somewhere. @param name for messages
/// @throws InputError for another number of channels, a value that is not finite or a voxel outside [0, resolution)³
void check_voxel_features(const sparse::SparseTensor& x, std::int64_t channels, std::int64_t resolution,
                          const std::string& name);
/// The part about the number of channels and of rows alone.
void check_voxel_rows(const sparse::SparseTensor& x, std::int64_t channels, const std::string& name);
/// The part about the voxels alone.
void check_voxels(const sparse::Support& support, std::int64_t resolution, const std::string& name);

}  // namespace anigen::models
