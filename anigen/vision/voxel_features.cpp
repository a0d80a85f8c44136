#include "anigen/vision/voxel_features.h"

#include <algorithm>
#include <fstream>
#include <utility>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/hash.h"
#include "anigen/nn/init.h"
#include "anigen/nn/profile.h"
#include "anigen/render/cameras_json.h"
#include "anigen/vision/condition.h"
#include "anigen/vision/surface_features.h"

namespace anigen::vision {

Tensor project_points(const Tensor& points, const Tensor& extrinsics, const Tensor& intrinsics) {
  const Tensor ones = torch::ones({points.size(0), 1}, points.options());
  const Tensor homogeneous = torch::cat({points, ones}, 1);
  const Tensor camera = torch::matmul(homogeneous, extrinsics.transpose(1, 2)).slice(2, 0, 3);
  const Tensor picture = torch::matmul(camera, intrinsics.transpose(1, 2));
  return picture.slice(2, 0, 2) / picture.slice(2, 2, 3) * 2.0 - 1.0;
}

Tensor sample_patches(const Tensor& patches, std::int64_t rows, std::int64_t columns, const Tensor& uv) {
  TORCH_CHECK(patches.dim() == 3 && patches.size(1) == rows * columns && uv.size(0) == patches.size(0), "patches ",
              patches.sizes(), " for ", rows, " x ", columns, " patches and projections ", uv.sizes());
  // Beyond ±2 everything is zero even for a single patch; grid_sample turns larger numbers into undefined integers.
  constexpr double kOutside = 4.0;
  const Tensor safe = torch::nan_to_num(uv, kOutside, kOutside, -kOutside).clamp(-kOutside, kOutside);
  const Tensor maps = patches.transpose(1, 2).reshape({patches.size(0), patches.size(2), rows, columns});
  namespace F = torch::nn::functional;
  const Tensor sampled = F::grid_sample(
      maps, safe.unsqueeze(1),
      F::GridSampleFuncOptions().mode(torch::kBilinear).padding_mode(torch::kZeros).align_corners(false));
  return sampled.squeeze(2).transpose(1, 2);
}

void ViewMean::add(const Tensor& per_view) {
  for (std::int64_t v = 0; v < per_view.size(0); ++v) {
    const Tensor view = per_view[v].detach().to(torch::kFloat32);
    sum_ = sum_.defined() ? sum_.add_(view) : view.clone();
    ++views_;
  }
}

Tensor ViewMean::mean() const {
  TORCH_CHECK(views_ > 0, "the mean of no view");
  return sum_ / static_cast<double>(views_);
}

namespace {

std::string text(const geometry::Voxel& voxel) {
  return "(" + std::to_string(voxel[0]) + ", " + std::to_string(voxel[1]) + ", " + std::to_string(voxel[2]) + ")";
}

namespace fs = std::filesystem;

Dinov2 loaded(const std::string& name, const fs::path& weights, const std::string& device) {
  const torch::Device place = nn::parse_device(device);
  Dinov2 model(Dinov2Options::named(name));
  load_dinov2_weights(model, weights);
  model->to(place);
  return model;
}

// So many views that the attention scores, twice (before and after the softmax), stay within a budget.
std::size_t views_per_batch(const Dinov2Options& options, int image_size, const torch::Device& device) {
  const auto side = static_cast<double>(image_size / options.patch_size);
  const double tokens = side * side + 1.0 + static_cast<double>(options.num_register_tokens);
  const double per_view = 2.0 * sizeof(float) * static_cast<double>(options.num_heads) * tokens * tokens;
  const double budget = device.is_cpu() ? 256e6 : 2e9;
  return static_cast<std::size_t>(std::clamp(budget / per_view, 1.0, 64.0));
}

template <int Size>
Tensor matrix_tensor(const Eigen::Matrix<double, Size, Size>& matrix) {
  const Tensor tensor = torch::empty({Size, Size}, torch::kFloat64);
  for (int i = 0; i < Size; ++i) {
    for (int j = 0; j < Size; ++j) tensor.data_ptr<double>()[i * Size + j] = matrix(i, j);
  }
  return tensor.to(torch::kFloat32);
}

Tensor centers_tensor(const prepare::FeatureRequest& request) {
  const Tensor centers = torch::empty({static_cast<std::int64_t>(request.voxels.size()), 3});
  float* out = centers.data_ptr<float>();
  for (const geometry::Voxel& voxel : request.voxels) {
    const Eigen::Vector3d center = geometry::voxel_center(voxel, request.resolution);
    for (Eigen::Index axis = 0; axis < 3; ++axis) *out++ = static_cast<float>(center[axis]);
  }
  return centers;
}

constexpr const char* kSurface = "surface";

}  // namespace

VoxelNeighbours::VoxelNeighbours(const std::vector<geometry::Voxel>& voxels, int resolution) : resolution_(resolution) {
  geometry::require_inside(voxels, resolution);
  places_.reserve(voxels.size());
  for (std::size_t i = 0; i < voxels.size(); ++i) places_.emplace_back(key(voxels[i]), i);
  std::sort(places_.begin(), places_.end());
  for (std::size_t i = 1; i < places_.size(); ++i) {
    if (places_[i].first != places_[i - 1].first) continue;
    const std::size_t twice = places_[i].second;
    throw InputError("", "voxel " + std::to_string(twice), text(voxels[twice]) + " is given twice");
  }
}

std::int64_t VoxelNeighbours::key(const geometry::Voxel& voxel) const {
  const std::int64_t size = resolution_;
  return (voxel[2] * size + voxel[1]) * size + voxel[0];
}

std::vector<std::size_t> VoxelNeighbours::within(const geometry::Voxel& voxel, int radius) const {
  const auto low = [&](std::int32_t i) { return std::max(i - radius, 0); };
  const auto high = [&](std::int32_t i) { return std::min(i + radius, resolution_ - 1); };
  std::vector<std::size_t> found;
  for (std::int32_t z = low(voxel[2]); z <= high(voxel[2]); ++z) {
    for (std::int32_t y = low(voxel[1]); y <= high(voxel[1]); ++y) {
      // The keys of one row along x follow each other.
      const std::int64_t last = key({high(voxel[0]), y, z});
      const auto first = std::make_pair(key({low(voxel[0]), y, z}), std::size_t{0});
      for (auto at = std::lower_bound(places_.begin(), places_.end(), first); at != places_.end() && at->first <= last;
           ++at) {
        found.push_back(at->second);
      }
    }
  }
  return found;
}

DinoFeatures::DinoFeatures(const std::string& name, const fs::path& weights, const std::string& device)
    : DinoFeatures(name, "", loaded(name, weights, device), kConditionSize) {
  fingerprint_ = name + " " + sha256_of_file(weights);
}

DinoFeatures::DinoFeatures(std::string name, std::string fingerprint, Dinov2 model, int image_size)
    : name_(std::move(name)), fingerprint_(std::move(fingerprint)), model_(std::move(model)), image_size_(image_size) {
  TORCH_CHECK(image_size > 0 && image_size % model_->options().patch_size == 0, "views of ", image_size,
              " pixels for patches of ", model_->options().patch_size);
}

io::NdArray DinoFeatures::extract(const prepare::FeatureRequest& request) const {
  geometry::require_inside(request.voxels, request.resolution);
  const render::Transforms views = render::read_transforms(request.views / "transforms.json");
  const torch::NoGradGuard no_grad;
  const torch::Device device = model_->parameters().front().device();
  if (request.voxels.empty()) return nn::to_array(torch::empty({0, channels()}, torch::kHalf));
  const Tensor centers = centers_tensor(request).to(device);
  const std::size_t batch = views_per_batch(model_->options(), image_size_, device);
  const std::int64_t side = image_size_ / model_->options().patch_size;
  ViewMean mean;
  for (std::size_t begin = 0; begin < views.frames.size(); begin += batch) {
    const std::size_t end = std::min(begin + batch, views.frames.size());
    std::vector<Tensor> images;
    for (std::size_t v = begin; v < end; ++v) {
      const io::Image picture = io::read_image(request.views / views.frames[v].file_path);
      images.push_back(view_image(picture, image_size_));
    }
    const Tensor patches = encode(torch::stack(images).to(device));
    for (std::size_t v = begin; v < end; ++v) {
      const auto at = static_cast<std::int64_t>(v - begin);
      const Tensor extrinsics = matrix_tensor<4>(render::extrinsics(views.frames[v])).to(device);
      const Tensor intrinsics = matrix_tensor<3>(render::intrinsics(views.frames[v])).to(device);
      const Tensor uv = project_points(centers, extrinsics.unsqueeze(0), intrinsics.unsqueeze(0));
      mean.add(sample_patches(patches.slice(0, at, at + 1), side, side, uv));
    }
  }
  return nn::to_array(mean.mean().to(torch::kHalf));
}

Tensor DinoFeatures::encode(const Tensor& images) const {
  const Dinov2Options& options = model_->options();
  const Tensor tokens = model_->tokens_after(imagenet_normalized(images), options.depth);
  return tokens.slice(1, 1 + options.num_register_tokens);
}

std::vector<std::string> feature_models() {
  std::vector<std::string> all = {kSurface};
  for (const std::string& name : Dinov2Options::names()) all.push_back(name);
  return all;
}

std::unique_ptr<prepare::FeatureExtractor> make_feature_extractor(const prepare::FeatureOptions& options) {
  const std::vector<std::string> known = feature_models();
  if (std::find(known.begin(), known.end(), options.model) == known.end()) {
    throw InputError(
        "", "",
        "there is no feature model '" + options.model + "'; " + suggestion(options.model, known, "use one of "));
  }
  if (options.model == kSurface) {
    if (!options.weights.empty())
      throw InputError(options.weights.string(), "", "feature model 'surface' takes no weights");
    return std::make_unique<SurfaceFeatures>();
  }
  if (options.weights.empty()) {
    throw InputError(
        "", "",
        "feature model '" + options.model + "' needs its published weights: give --feature-weights FILE (" +
            Dinov2Options::published_file_stem(options.model) +
            ".pth, or the same tensors as .safetensors), or use feature model 'surface', which needs none");
  }
  return std::make_unique<DinoFeatures>(options.model, options.weights, options.device);
}

}  // namespace anigen::vision
