#include "anigen/models/normal_estimator/dsine.h"

#include <memory>

#include "anigen/core/numeric.h"
#include "anigen/models/normal_estimator/convex_upsampling.h"
#include "anigen/models/normal_estimator/normal_propagation.h"

namespace anigen::models {
namespace {

constexpr std::int64_t kStateChannels = 64, kInputChannels = kStateChannels + 2;  // features and rays
constexpr std::int64_t kPropagationNeighbors = 25, kUpsamplingShares = 9 * 8 * 8;

Tensor slopes_of(const PinholeCamera& camera, const Tensor& map, std::int64_t reduction) {
  return ray_slopes(camera.reduced(reduction), map.size(2), map.size(3), map);
}

}  // namespace

DsineImpl::DsineImpl() {
  const auto encoder = register_module("encoder", std::make_shared<torch::nn::Module>());
  encoder_ = encoder->register_module("original_model", EfficientNetB5());
  decoder_ = register_module("decoder", NormalDecoder());
  gru_ = register_module("gru", ConvGru(kStateChannels, kInputChannels));
  const auto head = [](std::int64_t out) { return PredictionHead(kInputChannels, kStateChannels, out); };
  prob_head_ = register_module("prob_head", head(kPropagationNeighbors));
  xy_head_ = register_module("xy_head", head(2 * kPropagationNeighbors));
  angle_head_ = register_module("angle_head", head(kPropagationNeighbors));
  up_prob_head_ = register_module("up_prob_head", head(kUpsamplingShares));
  for (Tensor& parameter : parameters()) parameter.requires_grad_(false);
  eval();
}

EncoderMaps DsineImpl::encode(const Tensor& images) {
  TORCH_CHECK(images.dim() == 4 && images.size(1) == 3 && images.size(2) % kDsinePictureMultiple == 0 &&
                  images.size(3) % kDsinePictureMultiple == 0,
              "DSINE takes [B, 3, H, W] with sizes that are multiples of 32, not ", images.sizes());
  return encoder_(images);
}

DsineState DsineImpl::begin(const EncoderMaps& maps, const PinholeCamera& camera) {
  const RaySlopes slopes = {slopes_of(camera, maps.eighth, 8), slopes_of(camera, maps.sixteenth, 16),
                            slopes_of(camera, maps.thirty_second, 32)};
  const DecoderMaps decoded = decoder_(maps, slopes);
  DsineState state;
  state.camera = camera.reduced(8);
  state.slopes = slopes.eighth.expand({maps.eighth.size(0), -1, -1, -1});
  state.rays = unit_rays(slopes.eighth);
  state.input = torch::cat({decoded.feature, state.slopes}, 1);
  state.hidden = decoded.hidden;
  state.normals = ray_relu(decoded.normal, state.rays);
  return state;
}

void DsineImpl::refine(DsineState& state) {
  state.hidden = gru_(state.hidden, state.input);
  const Tensor x = torch::cat({state.hidden, state.slopes}, 1);
  NeighborRotations rotations;
  rotations.weights = prob_head_(x).sigmoid();
  rotations.directions = unit_vectors(xy_head_(x).view({x.size(0), 2, kPropagationNeighbors, x.size(2), x.size(3)}));
  rotations.angles = kPi * angle_head_(x).sigmoid();
  state.normals = propagated_normals(state.normals, rotations, state.camera, state.rays);
}

Tensor DsineImpl::upsampled(const DsineState& state) {
  const Tensor mask = up_prob_head_(torch::cat({state.hidden, state.slopes}, 1));
  return unit_vectors(convex_upsampling(state.normals, mask));
}

Tensor DsineImpl::forward(const Tensor& images, const PinholeCamera& camera, int iterations) {
  const torch::NoGradGuard no_grad;
  DsineState state = begin(encode(images), camera);
  for (int i = 0; i < iterations; ++i) refine(state);
  return upsampled(state);
}

}  // namespace anigen::models
