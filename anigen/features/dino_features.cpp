#include "anigen/features/dino_features.h"

#include <algorithm>
#include <fstream>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/sha256.h"
#include "anigen/features/backprojection.h"
#include "anigen/features/image_condition.h"
#include "anigen/models/dinov2_weights.h"
#include "anigen/models/tensor_arrays.h"
#include "anigen/raytrace/views/transforms_json.h"

namespace anigen::features {
namespace {

namespace fs = std::filesystem;

torch::Device parse_device(const std::string& name) {
  try {
    const torch::Device device(name);
    if (device.is_cpu() || (device.is_cuda() && torch::cuda::is_available())) return device;
  } catch (const c10::Error&) {
    // Fall through: LibTorch's message carries a stack trace.
  }
  throw InputError("", "--device", "there is no device '" + name + "' here; use cpu, cuda or cuda:N");
}

std::string digest_of(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  std::vector<char> block(std::size_t{1} << 20);
  Sha256 sha;
  while (stream.read(block.data(), static_cast<std::streamsize>(block.size())) || stream.gcount() > 0) {
    sha.update({block.data(), static_cast<std::size_t>(stream.gcount())});
  }
  return sha.finish();
}

models::Dinov2 loaded(const std::string& name, const fs::path& weights, const std::string& device) {
  const torch::Device place = parse_device(device);
  models::Dinov2 model(models::Dinov2Options::named(name));
  models::load_dinov2_weights(model, weights);
  model->to(place);
  return model;
}

// So many views that the attention scores, twice (before and after the softmax), stay within a budget.
std::size_t views_per_batch(const models::Dinov2Options& options, int image_size, const torch::Device& device) {
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

}  // namespace

DinoFeatures::DinoFeatures(const std::string& name, const fs::path& weights, const std::string& device)
    : DinoFeatures(name, "", loaded(name, weights, device), kConditionSize) {
  fingerprint_ = name + " " + digest_of(weights);
}

DinoFeatures::DinoFeatures(std::string name, std::string fingerprint, models::Dinov2 model, int image_size)
    : name_(std::move(name)), fingerprint_(std::move(fingerprint)), model_(std::move(model)), image_size_(image_size) {
  TORCH_CHECK(image_size > 0 && image_size % model_->options().patch_size == 0, "views of ", image_size,
              " pixels for patches of ", model_->options().patch_size);
}

io::NdArray DinoFeatures::extract(const prepare::FeatureRequest& request) const {
  geometry::require_inside(request.voxels, request.resolution);
  const raytrace::Transforms views = raytrace::read_transforms(request.views / "transforms.json");
  const torch::NoGradGuard no_grad;
  const torch::Device device = model_->parameters().front().device();
  if (request.voxels.empty()) return models::to_array(torch::empty({0, channels()}, torch::kHalf));
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
      const Tensor extrinsics = matrix_tensor<4>(raytrace::extrinsics(views.frames[v])).to(device);
      const Tensor intrinsics = matrix_tensor<3>(raytrace::intrinsics(views.frames[v])).to(device);
      const Tensor uv = project_points(centers, extrinsics.unsqueeze(0), intrinsics.unsqueeze(0));
      mean.add(sample_patches(patches.slice(0, at, at + 1), side, side, uv));
    }
  }
  return models::to_array(mean.mean().to(torch::kHalf));
}

Tensor DinoFeatures::encode(const Tensor& images) const {
  const models::Dinov2Options& options = model_->options();
  const Tensor tokens = model_->tokens_after(models::imagenet_normalized(images), options.depth);
  return tokens.slice(1, 1 + options.num_register_tokens);
}

}  // namespace anigen::features
