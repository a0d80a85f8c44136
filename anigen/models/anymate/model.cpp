#include "anigen/models/anymate/model.h"

#include "anigen/models/anymate/connectivity_heads.h"
#include "anigen/models/anymate/implicit_volume.h"
#include "anigen/models/anymate/init.h"
#include "anigen/models/anymate/joint_regression.h"
#include "anigen/models/anymate/skinning_heads.h"
#include "anigen/models/anymate/triplane_volume.h"

namespace anigen::models::anymate {
namespace {

void require_width(std::int64_t encoder, const ModelOptions& options) {
  const std::int64_t wanted = latent_width(options);
  if (encoder == wanted) return;
  throw InputError("", "width",
                   "'" + name_of(options.encoder) + "' gives latents of width " + std::to_string(encoder) + ", '" +
                       name_of(options.decoder) + "' takes " + std::to_string(wanted));
}

ConcatSkinningOptions concat_skinning(const ModelOptions& options) {
  ConcatSkinningOptions skinning = options.concat_skinning;
  skinning.separate = options.separate;
  return skinning;
}

template <typename Layer>
Layer with_defaults(Layer layer, nn::Init init) {
  if (init == nn::Init::kPublished) default_layers(*layer);
  return layer;
}

}  // namespace

std::shared_ptr<torch::nn::Module> make_decoder(const ModelOptions& options, nn::Init init) {
  const HeadOptions& head = options.head;
  switch (options.decoder) {
    case DecoderKind::kJointRegression:
      return std::make_shared<JointRegressionImpl>(head, options.num_joints, options.out_channels, init);
    case DecoderKind::kConcatDenoiser:
      return std::make_shared<ConcatDenoiserImpl>(options.concat_denoiser, init);
    case DecoderKind::kCrossDenoiser:
      return std::make_shared<CrossDenoiserImpl>(options.cross_denoiser, init);
    case DecoderKind::kImplicitVolume:
      return std::make_shared<ImplicitVolumeImpl>(head, init);
    case DecoderKind::kTriplaneVolume:
      return std::make_shared<TriplaneVolumeImpl>(options.triplane, init);
    case DecoderKind::kTokenConnectivity:
      return std::make_shared<TokenConnectivityImpl>(head, options.token_layers, options.head_token_length, init);
    case DecoderKind::kTwoBranchConnectivity:
      return std::make_shared<TwoBranchConnectivityImpl>(head, options.connectivity_layers, init);
    case DecoderKind::kConcatSkinning:
      return std::make_shared<ConcatSkinningImpl>(head, concat_skinning(options), init);
    case DecoderKind::kCrossSkinning:
      return std::make_shared<CrossSkinningImpl>(head, options.skinning_layers, options.separate, init);
  }
  throw InputError("", "decoder", "is none of the known ones");
}

AnymateModelImpl::AnymateModelImpl(const ModelOptions& options, nn::Init init) : options_(options) {
  make_encoder(init);
  decoder_ = register_module("decoder", make_decoder(options, init));
}

void AnymateModelImpl::make_encoder(nn::Init init) {
  const bool one_vector = options_.decoder == DecoderKind::kTriplaneVolume;
  switch (options_.encoder) {
    case EncoderKind::kBert: {
      ProjectionWidths widths = options_.projection;
      widths.in = options_.bert.trans_dim;
      require_width(widths.out, options_);
      bert_ = register_module("encoder", PointBert(options_.bert, init));
      if (one_vector) {
        pooled_projection_ = register_module("point_proj", PooledProjection(widths, bert_->token_count()));
        with_defaults(pooled_projection_, init);
      } else {
        token_projection_ = register_module("point_proj", TokenProjection(widths));
        with_defaults(token_projection_, init);
      }
      break;
    }
    case EncoderKind::kMichelangelo: {
      MichelangeloOptions michelangelo = options_.michelangelo;
      michelangelo.only_embed = one_vector;
      const std::int64_t width = michelangelo.width;
      require_width(width, options_);
      michelangelo_ = register_module("encoder", MichelangeloEncoder(michelangelo, init));
      if (options_.load_encoder && !one_vector) {
        loaded_projection_ = register_module("point_proj", ErfMlp(width, width, width, "0", "2"));
        with_defaults(loaded_projection_, init);
      }
      break;
    }
    case EncoderKind::kScratch: {
      const std::int64_t width = options_.scratch.width;
      require_width(width, options_);
      if (one_vector) throw InputError("", "encoder", "'transformer' has no single vector for 'triplane'");
      scratch_ = register_module("encoder", ScratchEncoder(options_.scratch, init));
      points_cloud_embed_ = register_module("points_cloud_embed", nn::Linear(width, width));
      with_defaults(points_cloud_embed_, init);
      break;
    }
  }
}

Tensor AnymateModelImpl::encode(const Tensor& points_cloud, const EncoderDraws& draws) {
  if (!bert_.is_empty()) {
    const Tensor tokens = bert_(points_cloud, draws.fps_start);
    return pooled_projection_.is_empty() ? token_projection_(tokens) : pooled_projection_(tokens);
  }
  if (!scratch_.is_empty()) return points_cloud_embed_(scratch_(points_cloud));
  const Tensor tokens = michelangelo_(points_cloud, draws.posterior_noise);
  return loaded_projection_.is_empty() ? tokens : loaded_projection_(tokens);
}

}  // namespace anigen::models::anymate
