#include "anigen/vision/lpips.h"

#include <limits>
#include <memory>
#include <optional>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/arrays/torch_archive.h"
#include "anigen/nn/init.h"
#include "anigen/nn/state_dict.h"

namespace anigen::vision {

namespace {

constexpr std::int64_t kSmallestPicture = 16;  // four halvings leave one pixel
constexpr double kNormEpsilon = 1e-10;         // outside the square root, as published

/// Place of a stage's convolutions in torchvision's list of layers (with ReLU and pooling between them), and their
/// number of output channels.
struct Stage {
  std::vector<int> layers;
  std::int64_t width;
};
const std::array<Stage, kLpipsStages>& vgg16() {
  static const std::array<Stage, kLpipsStages> kStages = {
      {{{0, 2}, 64}, {{5, 7}, 128}, {{10, 12, 14}, 256}, {{17, 19, 21}, 512}, {{24, 26, 28}, 512}}};
  return kStages;
}

Tensor unset(torch::IntArrayRef shape) { return torch::full(shape, std::numeric_limits<float>::quiet_NaN()); }

std::shared_ptr<torch::nn::Module> empty_module() { return std::make_shared<torch::nn::Module>(); }

/// From [0, 1] to what VGG16 was trained on: first to [-1, 1], then shifted and divided per channel.
Tensor normalized(const Tensor& picture) {
  const Tensor shift = torch::tensor({-0.030, -0.088, -0.188}, torch::kFloat64).to(picture.options()).view({3, 1, 1});
  const Tensor scale = torch::tensor({0.458, 0.448, 0.450}, torch::kFloat64).to(picture.options()).view({3, 1, 1});
  return (2.0 * picture - 1.0 - shift) / scale;
}

/// Divided by the norm over channels. The gradient of a norm at 0, where no channel is active, is taken as 0; the
/// published square root of a sum of squares gives NaN there.
Tensor unit_features(const Tensor& features) {
  return features / (torch::norm(features, 2, {1}, /*keepdim=*/true) + kNormEpsilon);
}

void check_pictures(const Tensor& a, const Tensor& b) {
  if (a.dim() != 4 || a.size(1) != 3 || a.sizes() != b.sizes())
    throw InputError("", "image", "LPIPS compares two batches [N, 3, H, W] of one shape");
  if (a.size(2) < kSmallestPicture || a.size(3) < kSmallestPicture)
    throw InputError("", "image", "LPIPS needs pictures of at least 16 × 16 pixels");
}

/// The stage (1 to 5) of a layer of torchvision's list: each ends before the next pooling.
int stage_of(int layer) { return layer < 4 ? 1 : layer < 9 ? 2 : layer < 16 ? 3 : layer < 23 ? 4 : 5; }

/// Names under which a weight is published.
std::vector<std::string> names_of(const std::string& key) {
  const std::string trunk = "features.";
  if (key.compare(0, trunk.size(), trunk) != 0) return {key};
  const std::string rest = key.substr(trunk.size());  // "28.weight"
  return {key, "net.slice" + std::to_string(stage_of(std::stoi(rest))) + "." + rest};
}

struct Found {
  const std::string* file;
  std::string name;
  const io::NdArray* array;
};

Found find_weight(const std::string& key, const std::vector<LpipsArrays>& sources) {
  std::optional<Found> found;
  std::string files;
  for (const LpipsArrays& source : sources) {
    files += (files.empty() ? "" : ", ") + source.file;
    for (const std::string& name : names_of(key)) {
      const io::NdArray* array = io::find(source.arrays, name);
      if (array == nullptr) continue;
      if (found) throw InputError(source.file, name, "stands in " + *found->file + " too, as " + found->name);
      found = Found{&source.file, name, array};
    }
  }
  if (found) return *found;
  throw InputError(files, key,
                   "is missing; LPIPS needs the convolutions of VGG16 (torchvision's vgg16: features.0 … features.28) "
                   "and the linear heads of the lpips package (lin0 … lin4)");
}

Tensor checked(const Found& found, torch::IntArrayRef shape) {
  const io::NdArray& array = *found.array;
  if (torch::IntArrayRef(array.shape) != shape) {
    throw InputError(
        *found.file, found.name,
        "has shape " + nn::shape_text(array.shape) + " where LPIPS with VGG16 has " + nn::shape_text(shape));
  }
  if (!nn::is_floating_point(array.dtype))
    throw InputError(*found.file, found.name, std::string("holds ") + io::name_of(array.dtype) + ", not weights");
  const Tensor values = nn::to_tensor(array).to(torch::kFloat32);
  if (!torch::isfinite(values).all().item<bool>())
    throw InputError(*found.file, found.name, "holds values that are not finite");
  return values;
}

}  // namespace

Vgg16FeaturesImpl::Vgg16FeaturesImpl() {
  std::int64_t in = 3;
  for (std::size_t s = 0; s < kLpipsStages; ++s) {
    const auto& [layers, out] = vgg16()[s];
    for (const int layer : layers) {
      const auto module = register_module(std::to_string(layer), empty_module());
      stages_[s].push_back({module->register_parameter("weight", unset({out, in, 3, 3}), /*requires_grad=*/false),
                            module->register_parameter("bias", unset({out}), /*requires_grad=*/false)});
      in = out;
    }
  }
}

Tensor Vgg16FeaturesImpl::stage(std::size_t index, Tensor x) const {
  if (index > 0) x = torch::max_pool2d(x, 2);
  for (const Convolution& layer : stages_[index])
    x = torch::relu(torch::conv2d(x, layer.weight, layer.bias, /*stride=*/1, /*padding=*/1));
  return x;
}

LpipsImpl::LpipsImpl() {
  features_ = register_module("features", Vgg16Features());
  for (std::size_t s = 0; s < kLpipsStages; ++s) {
    const auto head = register_module("lin" + std::to_string(s), empty_module());
    const auto model = head->register_module("model", empty_module());
    const auto convolution = model->register_module("1", empty_module());  // 0 is the dropout
    heads_[s] = convolution->register_parameter("weight", unset({1, vgg16()[s].width, 1, 1}), /*requires_grad=*/false);
  }
  eval();
}

Tensor LpipsImpl::stages(const Tensor& a, const Tensor& b) {
  check_pictures(a, b);
  Tensor x = normalized(a), y = normalized(b);
  std::vector<Tensor> distances;
  for (std::size_t s = 0; s < kLpipsStages; ++s) {
    x = features_->stage(s, x);
    y = features_->stage(s, y);
    const Tensor difference = (unit_features(x) - unit_features(y)).square();
    distances.push_back(torch::conv2d(difference, heads_[s]).mean({1, 2, 3}));
  }
  return torch::stack(distances);
}

Tensor LpipsImpl::forward(const Tensor& a, const Tensor& b) { return stages(a, b).sum(0); }

void set_lpips_weights(LpipsImpl& lpips, const std::vector<LpipsArrays>& sources) {
  std::vector<std::pair<Tensor, Tensor>> copies;
  for (const nn::StateEntry& entry : nn::state_entries(lpips))
    copies.emplace_back(entry.tensor, checked(find_weight(entry.key, sources), entry.tensor.sizes()));
  const torch::NoGradGuard no_grad;
  for (auto& [weight, values] : copies) weight.copy_(values);
}

Lpips load_lpips(const std::vector<std::filesystem::path>& files) {
  std::vector<LpipsArrays> sources;
  for (const std::filesystem::path& file : files) sources.push_back({file.string(), io::read_state_dict(file)});
  Lpips lpips;
  set_lpips_weights(*lpips, sources);
  return lpips;
}

}  // namespace anigen::vision
