#include "anigen/vision/dsine.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string_view>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"
#include "anigen/vision/dinov2.h"

namespace anigen::vision {

namespace {

Tensor pair_of(double u, double v, const Tensor& like) {
  return torch::tensor({u, v}, torch::kFloat64).view({1, 2, 1, 1}).to(like.options());
}

constexpr std::int64_t kStateChannels = 64, kInputChannels = kStateChannels + 2;  // features and rays
constexpr std::int64_t kPropagationNeighbors = 25, kUpsamplingShares = std::int64_t{9} * 8 * 8;

Tensor slopes_of(const PinholeCamera& camera, const Tensor& map, std::int64_t reduction) {
  return ray_slopes(camera.reduced(reduction), map.size(2), map.size(3), map);
}

constexpr std::int64_t kRadius = 2;
constexpr double kSmallestDepthSlope = 1e-8;

Tensor inner_product(const Tensor& a, const Tensor& b) { return (a * b).sum(1, /*keepdim=*/true); }

std::int64_t missing_pixels(std::int64_t size) {
  return (kDsinePictureMultiple - size % kDsinePictureMultiple) % kDsinePictureMultiple;
}

constexpr std::string_view kStateDict = "model.", kParallel = "module.", kCounter = ".num_batches_tracked";

bool begins_with(const std::string& key, std::string_view start) { return key.compare(0, start.size(), start) == 0; }

bool is_counter(const std::string& key) {
  return key.size() > kCounter.size() && key.compare(key.size() - kCounter.size(), kCounter.size(), kCounter) == 0;
}

// The state dict under its released keys, without the counters.
io::NamedArrays released_keys(io::NamedArrays arrays) {
  const bool nested =
      std::any_of(arrays.begin(), arrays.end(), [](const auto& entry) { return begins_with(entry.first, kStateDict); });
  io::NamedArrays state;
  for (auto& [key, array] : arrays) {
    if (nested && !begins_with(key, kStateDict)) continue;
    if (nested) key.erase(0, kStateDict.size());
    if (begins_with(key, kParallel)) key.erase(0, kParallel.size());
    if (!is_counter(key)) state.emplace_back(std::move(key), std::move(array));
  }
  return state;
}

void check_normal_picture(const torch::Tensor& rgb) {
  TORCH_CHECK(rgb.dim() == 4 && rgb.size(0) == 1 && rgb.size(1) == 3 && rgb.size(2) > 0 && rgb.size(3) > 0,
              "normals of one picture [1, 3, H, W], not ", rgb.sizes());
  const std::int64_t height = rgb.size(2), width = rgb.size(3);
  const PicturePadding padding = dsine_padding(height, width);
  const std::int64_t rows = height + padding.top + padding.bottom, columns = width + padding.left + padding.right;
  if (rows <= kMostNormalPixels / columns) return;
  throw InputError("", "image",
                   "a picture of " + std::to_string(width) + " x " + std::to_string(height) +
                       " pixels is too large for the normal estimator, which takes up to " +
                       std::to_string(kMostNormalPixels) + " pixels (4096 x 4096); make it smaller");
}

}  // namespace

PinholeCamera PinholeCamera::of_picture(std::int64_t height, std::int64_t width) {
  constexpr double kHalfAngle = kPi / 6.0;
  const double focal = 0.5 * static_cast<double>(std::max(height, width)) / std::tan(kHalfAngle);
  return {focal, focal, 0.5 * static_cast<double>(width), 0.5 * static_cast<double>(height)};
}

PinholeCamera PinholeCamera::padded(std::int64_t left, std::int64_t top) const {
  return {focal_u, focal_v, center_u + static_cast<double>(left), center_v + static_cast<double>(top)};
}

PinholeCamera PinholeCamera::reduced(std::int64_t factor) const {
  const auto by = static_cast<double>(factor);
  return {focal_u / by, focal_v / by, center_u / by, center_v / by};
}

Tensor PinholeCamera::focal(const Tensor& like) const { return pair_of(focal_u, focal_v, like); }
Tensor PinholeCamera::center(const Tensor& like) const { return pair_of(center_u, center_v, like); }

Tensor unit_vectors(const Tensor& v) { return v / v.norm(2, {1}, /*keepdim=*/true).clamp_min(1e-12); }

Tensor pixel_centers(std::int64_t rows, std::int64_t columns, const Tensor& like) {
  const Tensor u = (torch::arange(columns, like.options()) + 0.5).view({1, columns}).expand({rows, columns});
  const Tensor v = (torch::arange(rows, like.options()) + 0.5).view({rows, 1}).expand({rows, columns});
  return torch::stack({u, v}).unsqueeze(0);
}

Tensor ray_slopes(const PinholeCamera& camera, std::int64_t rows, std::int64_t columns, const Tensor& like) {
  return (pixel_centers(rows, columns, like) - camera.center(like)) / camera.focal(like);
}

Tensor unit_rays(const Tensor& slopes) {
  return unit_vectors(torch::cat({slopes, torch::ones_like(slopes.slice(1, 0, 1))}, 1));
}

Tensor ray_relu(const Tensor& normals, const Tensor& rays) {
  constexpr double kLeast = 0.01, kSmallestNorm = 1e-8;
  const auto norm = [](const Tensor& v) { return v.norm(2, {1}, /*keepdim=*/true).clamp_min(kSmallestNorm); };
  const Tensor cosine = (normals * rays).sum(1, /*keepdim=*/true) / (norm(normals) * norm(rays));
  return unit_vectors(normals + rays * (cosine.clamp_min(kLeast) - cosine));
}

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

Tensor neighborhood(const Tensor& x, std::int64_t radius) {
  const std::int64_t height = x.size(2), width = x.size(3), side = 2 * radius + 1;
  const Tensor wider = at::replication_pad2d(x, {radius, radius, radius, radius});
  std::vector<Tensor> all;
  for (std::int64_t row = 0; row < side; ++row) {
    for (std::int64_t column = 0; column < side; ++column)
      all.push_back(wider.narrow(2, row, height).narrow(3, column, width));
  }
  return torch::stack(all, 2);
}

Tensor rotation_axes(const Tensor& normals, const Tensor& directions, const Tensor& places,
                     const PinholeCamera& camera) {
  const Tensor focal = camera.focal(normals).unsqueeze(2), center = camera.center(normals).unsqueeze(2);
  const Tensor across = normals.slice(1, 0, 2), forward = normals.slice(1, 2, 3);
  const Tensor step = directions / focal;
  const Tensor slopes = (places + directions - center) / focal;
  Tensor facing = inner_product(slopes, across) + forward;  // 0 for a plane seen edge-on
  facing = torch::where(facing.abs() < kSmallestDepthSlope, kSmallestDepthSlope * facing.sign(), facing);
  const Tensor depth = -inner_product(step, across) / facing;
  const Tensor axes = unit_vectors(torch::cat({step + depth * slopes, depth}, 1));
  return axes.masked_fill(axes.isfinite().all(1, /*keepdim=*/true).logical_not(), 0.0);
}

Tensor rotated(const Tensor& vectors, const Tensor& axes, const Tensor& angles) {
  const Tensor no_axis = (axes == 0.0).all(1, /*keepdim=*/true);
  const Tensor turn = angles.masked_fill(no_axis, 0.0);  // the formula would shorten by cos(angle)
  const Tensor cosine = turn.cos(), across = at::linalg_cross(axes, vectors, 1);
  return vectors * cosine + across * turn.sin() + axes * (inner_product(axes, vectors) * (1.0 - cosine));
}

Tensor propagated_normals(const Tensor& normals, const NeighborRotations& rotations, const PinholeCamera& camera,
                          const Tensor& rays) {
  const Tensor around = neighborhood(normals, kRadius);
  const Tensor places = neighborhood(pixel_centers(normals.size(2), normals.size(3), normals), kRadius);
  const Tensor axes = rotation_axes(around, rotations.directions, places, camera);
  const Tensor turned = unit_vectors(rotated(around, axes, rotations.angles.unsqueeze(1)));
  const Tensor facing = ray_relu(turned, rays.unsqueeze(2));
  return unit_vectors((rotations.weights.unsqueeze(1) * facing).sum(2));
}

PicturePadding dsine_padding(std::int64_t height, std::int64_t width) {
  const std::int64_t rows = missing_pixels(height), columns = missing_pixels(width);
  return {columns / 2, columns - columns / 2, rows / 2, rows - rows / 2};
}

Tensor picture_normals(Dsine& network, const Tensor& rgb, int iterations) {
  const std::int64_t height = rgb.size(2), width = rgb.size(3);
  const PicturePadding padding = dsine_padding(height, width);
  const PinholeCamera camera = PinholeCamera::of_picture(height, width).padded(padding.left, padding.top);
  const Tensor picture = rgb.to(network->parameters().front().options());
  const Tensor framed = at::constant_pad_nd(picture, {padding.left, padding.right, padding.top, padding.bottom}, 0.0);
  const Tensor all = network->forward(imagenet_normalized(framed), camera, iterations);
  return all.narrow(2, padding.top, height).narrow(3, padding.left, width).contiguous();
}

void set_dsine_weights(Dsine& network, io::NamedArrays arrays, const std::string& file) {
  io::NamedArrays state = released_keys(std::move(arrays));
  nn::check_weight_values(state, file);
  for (const nn::StateEntry& entry : nn::state_entries(*network)) {
    if (is_counter(entry.key)) state.emplace_back(entry.key, nn::to_array(entry.tensor));
  }
  nn::load_state_dict(*network, state, nn::LoadMode::kStrict, file);
}

Dsine load_dsine(const std::filesystem::path& file) {
  Dsine network;
  set_dsine_weights(network, io::read_state_dict(file), file.string());
  return network;
}

DsineNormals::DsineNormals(const std::filesystem::path& weights, const torch::Device& device)
    : network_(load_dsine(weights)) {
  network_->to(device);
}

DsineNormals::DsineNormals(Dsine network) : network_(std::move(network)) {}

torch::Tensor DsineNormals::normals(const torch::Tensor& rgb) {
  check_normal_picture(rgb);
  return picture_normals(network_, rgb).to(rgb.device(), torch::kFloat32);
}

}  // namespace anigen::vision
