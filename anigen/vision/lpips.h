#pragma once
#include <array>
#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/io/arrays/ndarray.h"
#include "anigen/nn/torch.h"

namespace anigen::vision {

using torch::Tensor;

/// Stages of VGG16 (Simonyan and Zisserman 2015, configuration D) that LPIPS looks at: relu1_2, relu2_2, relu3_3,
/// relu4_3, relu5_3.
inline constexpr std::size_t kLpipsStages = 5;

/// The convolutions of VGG16 up to relu5_3, under torchvision's names "0.weight" … "28.bias".
class Vgg16FeaturesImpl : public torch::nn::Module {
 public:
  Vgg16FeaturesImpl();

  /// One stage applied to what the stage before it gave (the first one: to the picture). Stages after the first begin
  /// with a 2×2 maximum and thus halve height and width, rounded down.
  /// @param x [N, C, H, W] @return [N, width of the stage, H', W'], not negative
  Tensor stage(std::size_t index, Tensor x) const;

 private:
  struct Convolution {
    Tensor weight, bias;  // [out, in, 3, 3], [out]
  };
  std::array<std::vector<Convolution>, kLpipsStages> stages_;
};
TORCH_MODULE(Vgg16Features);

/// LPIPS v0.1 with the VGG16 trunk (Zhang et al. 2018, "The Unreasonable Effectiveness of Deep Features as a Perceptual
/// Metric", equation 1; docs/reference/training.md, 3.3): features of both pictures, each divided by its norm over
/// channels, squared difference, one weight per channel, mean over pixels, sum over five stages.
///
/// A metric (inside torch::NoGradGuard) and a loss: gradients reach both pictures, none reaches the weights, which
/// are frozen. Made without weights, which are NaN until load_lpips or set_lpips_weights fills them, so that nothing
/// plausible comes out of a network that was never loaded. Keys: "features.N.weight", "features.N.bias" as in
/// torchvision's vgg16, "lin0.model.1.weight" … "lin4.model.1.weight" as in the lpips package, whose dropout is left
/// out because it is never active.
class LpipsImpl : public torch::nn::Module {
 public:
  LpipsImpl();

  /// @param a, b [N, 3, H, W] colours in [0, 1], H and W at least 16; dtype and device of the weights
  /// @return [N] distances, 0 for equal pictures; symmetric. The published loss is their mean.
  /// @throws InputError for other shapes
  Tensor forward(const Tensor& a, const Tensor& b);

  /// Part of each stage in the distance. @return [5, N]
  Tensor stages(const Tensor& a, const Tensor& b);

 private:
  Vgg16Features features_ = nullptr;
  std::array<Tensor, kLpipsStages> heads_;  // [1, C, 1, 1]
};
TORCH_MODULE(Lpips);

/// Arrays with the name of the file they come from.
struct LpipsArrays {
  std::string file;
  io::NamedArrays arrays;
};

/// Fills the network, in fp32. Trunk: "features.N.weight" and "features.N.bias" (torchvision's vgg16, whose classifier
/// is ignored like every other key), or "net.sliceS.N.weight" (a whole LPIPS of the lpips package). Heads:
/// "linS.model.1.weight". Trunk and heads may stand in one file or in several, in any order.
/// @throws InputError naming file and key for a weight that is missing, stands twice, has another shape, is not
/// floating-point, or is not finite; the network is then unchanged
void set_lpips_weights(LpipsImpl& lpips, const std::vector<LpipsArrays>& sources);

/// LPIPS with weights from `.pt`, `.pth` or `.safetensors` files (io::read_state_dict), on the CPU.
/// @throws InputError also for files that cannot be read
Lpips load_lpips(const std::vector<std::filesystem::path>& files);

}  // namespace anigen::vision
