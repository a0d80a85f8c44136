#pragma once
#include <functional>
#include <string>
#include <vector>

#include "anigen/nn/embeddings.h"
#include "anigen/nn/linear.h"
#include "anigen/skeleton_field/field.h"
#include "anigen/sparse/blocks.h"
#include "anigen/structured_latent/options.h"

namespace anigen::structured_latent {

/// Linear · SiLU · layer norm (eps 1e-5): tokens of joints. Keys `0.*` and `2.*`.
class JointTokensImpl : public torch::nn::Module {
 public:
  JointTokensImpl(std::int64_t in_channels, std::int64_t channels);
  torch::Tensor forward(const torch::Tensor& x);

 private:
  nn::Linear linear_ = nullptr;
  nn::AffineLayerNorm norm_ = nullptr;
};
TORCH_MODULE(JointTokens);

/// The skin stream attends to the joints of its asset (`skin_cross_from_groupped`; docs/reference/autoencoders.md,
/// 4.8). Not a module of its own: registers `root_parent_feat`, `joints_in_proj.*`, `joints_self_attn.{0..3}.*`,
/// `h_skin_coord_proj.*`, `h_skin_coord_fuse.*` and `skin_cross_groupped_net.*` with the model.
class GroupedCross {
 public:
  GroupedCross() = default;
  GroupedCross(torch::nn::Module& model, const StructuredLatentDecoderOptions& options);
  bool present() const { return root_parent_feat_.defined(); }

  /// @param skin the skin stream @param skeletons, features per asset @return the support and dtype of skin
  sparse::SparseTensor forward(const sparse::SparseTensor& skin,
                               const std::vector<skeleton_field::SkeletonTensors>& skeletons,
                               const std::vector<skeleton_field::JointSkinFeatures>& features);

  void initialize();  ///< the root's feature to zero; layers are the model's to initialise

  /// Names of the modules that are fp16 with use_fp16, for FreezableModel.
  static std::vector<std::string> names();

 private:
  sparse::SparseTensor joint_context(const std::vector<skeleton_field::SkeletonTensors>& skeletons,
                                     const std::vector<skeleton_field::JointSkinFeatures>& features,
                                     torch::Dtype dtype);

  std::int64_t resolution_ = 0;
  nn::FourierEmbedding fourier_{1};
  torch::Tensor root_parent_feat_;  ///< [F]
  JointTokens joint_tokens_ = nullptr;
  std::vector<sparse::SparseTransformerBlock> joint_blocks_;
  nn::Linear place_ = nullptr, fuse_ = nullptr;
  sparse::SparseMultiContextBlock cross_ = nullptr;
};

/// Sparse U-Net that smooths the skin stream, at R and coarser, always in fp32 (docs/reference/autoencoders.md, 4.8).
/// Keys `enc.{i}.*`, `mid.*`, `fuse.{i}.*`, `dec.{i}.*` with the keys of SubdivideBlock below them.
class SkinUnetImpl : public torch::nn::Module {
 public:
  /// @param levels halvings of the resolution, at least 1
  SkinUnetImpl(std::int64_t channels, std::int64_t levels);
  /// @return the support and dtype of x
  sparse::SparseTensor forward(const sparse::SparseTensor& x);

 private:
  std::vector<sparse::SubdivideBlock> down_blocks_, up_blocks_;
  sparse::SubdivideBlock middle_ = nullptr;
  std::vector<nn::Linear> fuse_;
};
TORCH_MODULE(SkinUnet);

/// One of something for each stream of the structured latents.
template <typename T>
struct PerStream {
  T geometry, skin, skeleton;
};

/// The three transformers that encoder and decoder have alike (docs/reference/autoencoders.md, 4.1): per stream an
/// input layer with the position embedding of the voxel indices, then blocks, in which skin and skeleton may attend to
/// each other and to the geometry as they were before the block. Not a module of its own, since the published keys lie
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
  /// The geometry stream alone, which hears nothing of the others.
  sparse::SparseTensor forward_geometry(const sparse::SparseTensor& x);

  /// Blocks keep only their inputs for the backward pass and run again in it (nn::recomputed).
  void recompute_blocks(bool on) { recompute_ = on; }

  /// Names of the modules that are the torso, for FreezableModel.
  static std::vector<std::string> names() { return {"blocks", "blocks_skin", "blocks_skl"}; }

 private:
  using CrossBlocks = std::vector<sparse::SparseMultiContextBlock>;
  sparse::SparseTensor run_geometry(std::size_t i, const sparse::SparseTensor& h) const;
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

/// The published start of everything below `module` (docs/reference/autoencoders.md, 1.6): Xavier-uniform linears with
/// zero biases, norms 1 and 0, sparse convolutions as the library's, the last one of each up-sampling block zero.
void initialize_sparse_layers(torch::nn::Module& module);

/// An output layer of the decoder: Kaiming-normal weights (fan-in, gain √2) times 1e-4, zero bias.
void initialize_field_head(nn::LinearImpl& head);

}  // namespace anigen::structured_latent
