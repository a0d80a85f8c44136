#pragma once
#include <cstdint>

#include "anigen/anymate/blocks.h"
#include "anigen/nn/init.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/torch.h"

namespace anigen::anymate {

/// Options that the attention heads of all tasks share, under the released argument names.
struct HeadOptions {
  std::int64_t width = 768, heads = 12;
  std::int64_t num_freqs = 8;  ///< of the Fourier features of positions, with the factor π
  bool qkv_bias = false;
  double init_scale = 0.25;  ///< taken as the standard deviation itself, as released, so that training starts with
                             ///< large weights
};

/// Logits of pairs of tokens, (k_proj ln_1 a) (q_proj ln_2 b)ᵀ. Puts `q_proj`, `k_proj`, `ln_1`, `ln_2` into the head.
class PairLogits {
 public:
  PairLogits() = default;
  PairLogits(torch::nn::Module& head, std::int64_t width);
  Tensor columns(const Tensor& b) { return q_proj_(ln_2_(b)).transpose(1, 2); }  ///< [B, K, W] → [B, W, K]
  /// @param a [B, N, W] @return [B, N, K]
  Tensor of(const Tensor& a, const Tensor& columns) { return torch::matmul(k_proj_(ln_1_(a)), columns); }

 private:
  nn::Linear q_proj_ = nullptr, k_proj_ = nullptr;
  nn::AffineLayerNorm ln_1_ = nullptr, ln_2_ = nullptr;
};

/// Connectivity: the parent of each joint, from joints and a shape. Row i of the logits is joint i as a child, column m
/// a candidate for its parent, and column i of row i says that i is a root (docs/reference/anymate.md, 1.6 and 4).
class ConnectivityImpl : public torch::nn::Module {
 public:
  /// @param latents [B, L, W] @param joints [B, J or more, 3] in [-1, 1], padded @param mask [B, J], not zero for real
  ///   joints; undefined: all of them are @return [B, J, J] logits @throws InputError for shapes
  virtual Tensor forward(const Tensor& latents, const Tensor& joints, const Tensor& mask = {}) = 0;
  /// With true the roles change sides, as in Anymate's text: of the matrix that the model makes of its two kinds of
  /// tokens columns are children, and forward() returns its transpose.
  void columns_are_children(bool on) { columns_are_children_ = on; }

 protected:
  Tensor with_children_in_rows(const Tensor& logits) const {
    return columns_are_children_ ? logits.transpose(1, 2) : logits;
  }

 private:
  bool columns_are_children_ = false;
};

/// Mean over all rows of a batch, padded ones included (they add nothing), of - Σ y ln(softmax(logits) + 1e-6).
/// @param logits [B, J, J] @param parents [B, J or more, J] one in the column of the parent (a root's own), zero rows
/// for
///   padding (AnymateBatch::conns) @return scalar @throws InputError for shapes
Tensor connectivity_loss(const Tensor& logits, const Tensor& parents);

/// Plain binary cross entropy of softmax(logits), mean over the entries of real joints: the loss of Anymate's text,
/// where the released code has connectivity_loss(). @param mask [B, J], not zero for real joints; undefined: all of
/// them are @return scalar @throws InputError for shapes
Tensor connectivity_bce(const Tensor& logits, const Tensor& parents, const Tensor& mask = {});

/// The most likely parent of each joint; a joint that is its own parent is a root. Nothing makes a tree of it: several
/// roots, none, and cycles are possible. @param logits [J, J] or [B, J, J] @return [J] or [B, J] int64
Tensor likeliest_parents(const Tensor& logits);

/// Bones of a skeleton as Anymate's skinning takes them: for each joint that is no root, in order, the position of its
/// parent, then its own. @param joints [J, 3] @param parents [J] int64, its own index for a root @return [K, 6]
/// @throws InputError for shapes and for a parent that is no joint
Tensor bones_of(const Tensor& joints, const Tensor& parents);

/// "attendjoints_con_combine" (docs/reference/anymate.md, 4.1): joints become child tokens in one branch and parent
/// tokens in another; branches share their attention to the latents and have their own among joints. Masked columns get
/// -1e8. Keys `co_proj`, `cross_attn.<j>.*`, `self_attn.<layers · branch + j>.*`, `q_proj`, `k_proj`, `ln_1`, `ln_2`.
class TwoBranchConnectivityImpl : public ConnectivityImpl {
 public:
  explicit TwoBranchConnectivityImpl(const HeadOptions& options = {}, std::int64_t layers = 2,
                                     nn::Init init = nn::Init::kPublished);
  Tensor forward(const Tensor& latents, const Tensor& joints, const Tensor& mask = {}) override;

 private:
  HeadOptions options_;
  nn::Linear co_proj_ = nullptr;
  std::vector<ResidualCrossAttention> cross_attn_;
  std::vector<ResidualAttention> self_attn_;
  PairLogits pairs_;
};
TORCH_MODULE(TwoBranchConnectivity);

/// Three linear maps in a row, without anything between them, and a layer norm, as released. Keys `0.*` … `3.*`.
class LinearChainImpl : public torch::nn::Module {
 public:
  LinearChainImpl(std::int64_t in, std::int64_t out);
  Tensor forward(const Tensor& x) { return norm_(third_(second_(first_(x)))); }

 private:
  nn::Linear first_ = nullptr, second_ = nullptr, third_ = nullptr;
  nn::AffineLayerNorm norm_ = nullptr;
};
TORCH_MODULE(LinearChain);

/// "attendjoints_con_token" (docs/reference/anymate.md, 4.2): joints and latents through one transformer; a learned
/// token beside each joint says whether it is meant as a child or as a parent. Masked joints are hidden from the
/// attention only: their columns keep their logits. Keys `head_token`, `tail_token` [1, 1, T], `layer_norm`,
/// `head_mlp.{0..3}`, `tail_mlp.{0..3}`, `self_attn.resblocks.<i>.*`, `joints_proj`, `output_proj_joints`.
class TokenConnectivityImpl : public ConnectivityImpl {
 public:
  explicit TokenConnectivityImpl(const HeadOptions& options = {}, std::int64_t layers = 4,
                                 std::int64_t token_length = 128, nn::Init init = nn::Init::kPublished);
  Tensor forward(const Tensor& latents, const Tensor& joints, const Tensor& mask = {}) override;

 private:
  HeadOptions options_;
  Tensor head_token_, tail_token_;
  nn::AffineLayerNorm layer_norm_ = nullptr;
  LinearChain head_mlp_ = nullptr, tail_mlp_ = nullptr;
  ResidualStack self_attn_ = nullptr;
  nn::Linear joints_proj_ = nullptr, output_proj_joints_ = nullptr;
};
TORCH_MODULE(TokenConnectivity);

/// Input of a skinning head.
struct SkinningInput {
  Tensor latents;  ///< [B, L, W]
  Tensor points;   ///< [B, N, 6], positions in [-1, 1] and unit normals: of surface samples or of vertices
  Tensor bones;    ///< [B, K or more, 6], head and tail in [-1, 1], padded
  Tensor mask;     ///< [B, K], not zero for real bones; undefined: all of them are
};

/// Logits of each bone at each point; the softmax over bones gives the skin weights. Masked bones get -1e8.
class SkinningImpl : public torch::nn::Module {
 public:
  /// @param chunk points at a time, 0: as many as the head thinks best. The result does not depend on it.
  /// @return [B, N, K] @throws InputError for shapes
  virtual Tensor forward(const SkinningInput& input, std::int64_t chunk = 0) = 0;
};

/// Points and bones as tokens (docs/reference/anymate.md, 5.1). Not a module: registers its maps in the head, with the
/// keys `bone_proj.*`, and `co_proj.*` and `normal_proj.*` or, as the option `separate` has it, `pc_proj.*`.
class SkinningEmbedding {
 public:
  SkinningEmbedding() = default;
  SkinningEmbedding(torch::nn::Module& head, const HeadOptions& options, bool separate);
  Tensor points(const Tensor& points);  ///< @param points [B, N, 6] @return [B, N, W]
  Tensor bones(const Tensor& bones);    ///< @param bones [B, K, 6] @return [B, K, W]

 private:
  std::int64_t num_freqs_ = 0;
  nn::Linear bone_proj_ = nullptr, co_proj_ = nullptr, normal_proj_ = nullptr, pc_proj_ = nullptr;
};

/// `count` of `points` indices in random order, from torch's default generator: the subset that a training step takes,
/// the same for all items of a batch (1,024 of 8,192 as released). @return [count] int64 @throws InputError
Tensor training_points(std::int64_t points, std::int64_t count = 1024);

/// For heads that know sampled points only: each vertex gets the logits of the nearest point, of equally near ones the
/// first. @param vertices [V, 3] @param points [N, 3] @param logits [N, K] @return [V, K] @throws InputError
Tensor nearest_point_logits(const Tensor& vertices, const Tensor& points, const Tensor& logits);

/// Losses over bones, means over all points of a batch (docs/reference/anymate.md, 5 and 6.4). The softmax is taken in
/// the dtype of the logits, everything else in the wider dtype of the two.
struct SkinningLosses {
  Tensor cos;        ///< 1 - cosine of softmax and truth
  Tensor cos_clamp;  ///< the same of clamp(1.002 softmax - 0.001, 0, 1): the released training loss
  Tensor ce;         ///< - Σ truth ln(softmax + 1e-6)
};
/// @param logits, truth [B, N, K]; rows of the truth need not sum to 1 @throws InputError for shapes
SkinningLosses skinning_losses(const Tensor& logits, const Tensor& truth);

/// "attendjoints_combine" (docs/reference/anymate.md, 5.1): points and bones attend to the latents, then to the bones,
/// twice. Points do not see each other, so they can be taken in any chunks, and mesh vertices are asked about directly.
/// Keys `bone_proj` … (SkinningEmbedding), `cross_attn.<i>.*`, `cross_attn_joint.<i>.*`, `q_proj`, `k_proj`, `ln_1`,
/// `ln_2`.
class CrossSkinningImpl : public SkinningImpl {
 public:
  /// @param separate one map for positions and normals together
  explicit CrossSkinningImpl(const HeadOptions& options = {}, std::int64_t layers = 2, bool separate = false,
                             nn::Init init = nn::Init::kPublished);
  /// With chunk 0, all points at once while gradients are recorded, else 8,192 at a time.
  Tensor forward(const SkinningInput& input, std::int64_t chunk = 0) override;

 private:
  /// Bone tokens as each layer offers them to be attended to, and at last after all layers.
  std::vector<Tensor> bone_stream(const Tensor& bones, const Tensor& latents, const KeyMask& keys);

  HeadOptions options_;
  SkinningEmbedding embedding_;
  std::vector<ResidualCrossAttention> cross_attn_, cross_attn_joint_;
  PairLogits pairs_;
};
TORCH_MODULE(CrossSkinning);

struct ConcatSkinningOptions {
  std::int64_t layers = 4;
  std::int64_t concat_num = 512;  ///< points that go through the transformer together
  bool separate = false;          ///< one map for positions and normals together
  /// The released code lays masks out run after run and sequences item after item, so that in a batch of several items
  /// run c of item b hides the bones of item (b · runs + c) mod B. True computes that too; false gives every item its
  /// own mask. The same for one item, and for items with equally many bones.
  bool tiled_masks = false;
};

/// "attendjoints_multi" (docs/reference/anymate.md, 5.2): each run of concat_num points goes through one transformer
/// together with all bones and latents. Runs are part of what the model means, so there must be a whole number of them;
/// mesh vertices take the logits of the nearest point (nearest_point_logits). Keys `self_attn.resblocks.<i>.*`,
/// `bone_proj` … (SkinningEmbedding), `output_proj_joints`, `output_proj_points`, `layer_norm`.
class ConcatSkinningImpl : public SkinningImpl {
 public:
  explicit ConcatSkinningImpl(const HeadOptions& head = {}, const ConcatSkinningOptions& options = {},
                              nn::Init init = nn::Init::kPublished);
  /// @param chunk a multiple of concat_num; 0: one run at a time @throws InputError also when runs are not whole
  Tensor forward(const SkinningInput& input, std::int64_t chunk = 0) override;

 private:
  /// @param points [B, r · concat_num, W] tokens @param masks [B, r, K] of each run, or undefined
  /// @return [B, r · concat_num, K]
  Tensor run_logits(const Tensor& points, const Tensor& bones, const Tensor& latents, const Tensor& masks);

  HeadOptions head_;
  ConcatSkinningOptions options_;
  SkinningEmbedding embedding_;
  ResidualStack self_attn_ = nullptr;
  nn::Linear output_proj_joints_ = nullptr, output_proj_points_ = nullptr;
  nn::AffineLayerNorm layer_norm_ = nullptr;
};
TORCH_MODULE(ConcatSkinning);

}  // namespace anigen::anymate
