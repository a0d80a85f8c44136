#pragma once
#include <memory>
#include <string>
#include <vector>

#include "anigen/anymate/denoisers.h"
#include "anigen/anymate/heads.h"
#include "anigen/anymate/point_encoders.h"
#include "anigen/anymate/style.h"
#include "anigen/core/config_fields.h"
#include "anigen/core/error.h"
#include "anigen/nn/torch.h"

namespace anigen::anymate {

enum class EncoderKind { kBert, kMichelangelo, kScratch };

enum class DecoderKind {
  kJointRegression,        ///< "Regress"
  kConcatDenoiser,         ///< "Diff-Concat"
  kCrossDenoiser,          ///< "Diff-Cross"
  kImplicitVolume,         ///< "Vol-Implicit"
  kTriplaneVolume,         ///< "Vol-TriPlane"
  kTokenConnectivity,      ///< "Token"
  kTwoBranchConnectivity,  ///< "2Branch"
  kConcatSkinning,         ///< "Concat"
  kCrossSkinning           ///< "Cross"
};

/// Released names: bert, miche, transformer.
const std::vector<std::string>& encoder_names();
/// Released names: transformer_latent, Pointe_Diffusion, Cross_Attention_Diffusion, implicit_transformer, triplane,
/// attendjoints_con_token, attendjoints_con_combine, attendjoints_multi, attendjoints_combine; in the order of
/// DecoderKind.
const std::vector<std::string>& decoder_names();
const std::string& name_of(EncoderKind kind);
const std::string& name_of(DecoderKind kind);

/// Task and architecture of a decoder.
enum class Task { kJointRegression, kDenoisedJoints, kJointVolume, kConnectivity, kSkinning };
Task task_of(DecoderKind kind);

/// Sizes of a model; the defaults are the released ones (docs/reference/anymate.md, 2, 3, 4 and 5).
struct ModelOptions : JsonOptions<ModelOptions> {
  EncoderKind encoder = EncoderKind::kBert;
  DecoderKind decoder = DecoderKind::kJointRegression;

  HeadOptions head;
  std::int64_t num_joints = 96, out_channels = 3;  ///< of the regression
  std::int64_t connectivity_layers = 2;            ///< of each branch
  std::int64_t token_layers = 4, head_token_length = 128;
  std::string children = "rows";  ///< ours: of the connectivity's matrix, or "columns" (ConnectivityImpl)
  std::int64_t skinning_layers = 2;
  ConcatSkinningOptions concat_skinning;  ///< but `separate`, which is below
  bool separate = false;                  ///< skinning: one map for positions and normals
  ConcatDenoiserOptions concat_denoiser;
  CrossDenoiserOptions cross_denoiser;
  StyleGeneratorOptions triplane;

  PointBertOptions bert;
  ProjectionWidths projection;  ///< from Point-BERT's width to the head's
  MichelangeloOptions michelangelo;
  ScratchEncoderOptions scratch;
  bool load_encoder = false;  ///< Michelangelo taken from another model: its tokens pass through two more maps

  /// The whole released model of two names. @throws InputError for an unknown one
  static ModelOptions released(const std::string& encoder, const std::string& decoder);

  /// By the name of a released checkpoint, "<encoder>-<decoder>-….pth.tar". @throws InputError
  static ModelOptions from_checkpoint_name(const std::string& file_name);

  /// The `model:` block of a released config, which checkpoints carry as `model_config`: encoder, decoder, num_joints,
  /// out_channels, width, heads, init_scale, qkv_bias, separate, load_encoder; num_z, num_x, z_dim, x_dim, num_blocks,
  /// num_compute_layers, num_heads, mlp_ratio, num_latents, use_projection; n_ctx, layers, cond_drop_prob. `flash`,
  /// `num_x`, `n_ctx` and the keys of the diffusion schedule change nothing here. As released, width and heads do not
  /// reach the concatenation denoiser. Ours, for small models: objects `bert`, `michelangelo`, `scratch`,
  /// `concat_denoiser`, `concat_skinning` and `triplane` with the names of the options above, `projection_1` and
  /// `projection_2` within `bert`, and the numbers of layers, the head_token_length and `children` of this struct.
  /// @throws InputError for an unknown key or a value out of range
  void fields(ConfigFields& f);
};

/// One sample of Anymate's data, as its files hold it (docs/reference/anymate.md, 1.2), in its frame: longest side from
/// -1 to 1, Y up. What is undefined is left out of the batch; joints and bones must be there.
struct AnymateSample {
  std::string name;     ///< for messages
  Tensor points_cloud;  ///< `pc` [N, 6] positions and face normals
  Tensor joints;        ///< [J, 3]
  Tensor conns;         ///< [J] integers: the parent of each joint, a root itself
  Tensor bones;         ///< [K, 6] head and tail
  Tensor skins_index;   ///< [N, m] integers: bones that hold a point, -1 for none
  Tensor skins_weight;  ///< [N, m] their weights
  Tensor vox;           ///< [V, 3] integers: occupied cells
};

struct CollateOptions {
  std::int64_t max_joints = 96, max_bones = 64;  ///< rows that joints and bones are padded to, with -3
};

/// Samples as tensors with an axis of items (docs/reference/anymate.md, 1.6). What samples lack is undefined.
struct AnymateBatch {
  std::vector<std::string> names;
  Tensor points_cloud;                   ///< [B, N, 6] fp32
  Tensor joints;                         ///< [B, max_joints, 3] fp32
  std::vector<std::int64_t> joints_num;  ///< J of each item
  Tensor joints_mask;                    ///< [B, Jmax] bool
  Tensor conns;                          ///< [B, max_joints, Jmax] fp32: one at [child, parent]
  Tensor bones;                          ///< [B, max_bones, 6] fp32
  std::vector<std::int64_t> bones_num;   ///< K of each item
  Tensor bones_mask;                     ///< [B, Kmax] bool
  Tensor skins;                          ///< [B, N, Kmax] fp64, as released
  std::vector<Tensor> vox;               ///< of each item
  Tensor joints_repeat;                  ///< [B, n, 3] fp32, of collate_diffusion only
};

/// For all tasks but diffusion. @throws InputError naming the sample: nothing to collate, shapes, more joints or bones
///   than rows, indices of joints or bones that do not exist, something that only some samples have
AnymateBatch collate(const std::vector<AnymateSample>& samples, const CollateOptions& options = {});

/// For diffusion: positions alone, and `points` joints of each item, its own repeated in turn. No masks, connectivity
/// or skin. @throws InputError as collate
AnymateBatch collate_diffusion(const std::vector<AnymateSample>& samples, std::int64_t points = 128,
                               const CollateOptions& options = {});

/// A decoder by its kind, as its own class behind the base class. docs/reference/anymate.md, 3, 4 and 5.
std::shared_ptr<torch::nn::Module> make_decoder(const ModelOptions& options, nn::Init init = nn::Init::kPublished);

/// An encoder and one decoder, with the keys of released checkpoints: `encoder.*`, `point_proj.*` (Point-BERT, and
/// Michelangelo with load_encoder), `points_cloud_embed.*` (scratch encoder), `decoder.*` (docs/reference/anymate.md,
/// 2). Load a checkpoint's `state_dict` strictly (nn/state_dict.h).
class AnymateModelImpl : public torch::nn::Module {
 public:
  explicit AnymateModelImpl(const ModelOptions& options, nn::Init init = nn::Init::kPublished);

  /// Draws of an encoder, to be given where a result must not depend on chance.
  struct EncoderDraws {
    Tensor fps_start;        ///< [B] int64, see PointBertImpl::forward
    Tensor posterior_noise;  ///< [B, M, E], see MichelangeloEncoderImpl::forward
  };
  /// @param points_cloud [B, N, 6], positions in [-1, 1] and unit normals
  /// @return [B, L, W]; for the tri-plane decoder [B, W] @throws InputError for shapes
  Tensor encode(const Tensor& points_cloud, const EncoderDraws& draws = {});

  /// The decoder as its class, such as CrossSkinningImpl, or as one of the bases JointDenoiserImpl, JointVolumeImpl,
  /// ConnectivityImpl and SkinningImpl. @throws InputError when it is of another class
  template <typename Decoder>
  Decoder& decoder() {
    auto* found = dynamic_cast<Decoder*>(decoder_.get());
    if (found == nullptr) throw InputError("", "decoder", "'" + name_of(options_.decoder) + "' is for another task");
    return *found;
  }

  const ModelOptions& options() const { return options_; }

 private:
  void make_encoder(nn::Init init);

  ModelOptions options_;
  PointBert bert_ = nullptr;
  MichelangeloEncoder michelangelo_ = nullptr;
  ScratchEncoder scratch_ = nullptr;
  TokenProjection token_projection_ = nullptr;
  PooledProjection pooled_projection_ = nullptr;
  ErfMlp loaded_projection_ = nullptr;
  nn::Linear points_cloud_embed_ = nullptr;
  std::shared_ptr<torch::nn::Module> decoder_;
};
TORCH_MODULE(AnymateModel);

}  // namespace anigen::anymate
