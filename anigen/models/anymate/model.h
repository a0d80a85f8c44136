#pragma once
#include <memory>

#include "anigen/core/error.h"
#include "anigen/models/anymate/model_options.h"

namespace anigen::models::anymate {

/// A decoder by its kind, as its own class behind the base class. Reference anymate-baselines.md, 3 to 5.
std::shared_ptr<torch::nn::Module> make_decoder(const ModelOptions& options, nn::Init init = nn::Init::kPublished);

/// An encoder and one decoder, with the keys of released checkpoints: `encoder.*`, `point_proj.*` (Point-BERT, and
/// Michelangelo with load_encoder), `points_cloud_embed.*` (scratch encoder), `decoder.*` (reference
/// anymate-baselines.md, 2.0). Load a checkpoint's `state_dict` strictly (models/state_dict.h).
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

}  // namespace anigen::models::anymate
