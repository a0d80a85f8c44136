#include "anigen/models/image_loss.h"

#include <vector>

#include "anigen/core/error.h"
#include "anigen/nn/shape_text.h"

namespace anigen::models {
namespace {

using torch::Tensor;

constexpr std::int64_t kSsimWindow = 11;
constexpr double kSsimDeviation = 1.5;
constexpr double kSsimC1 = 0.01 * 0.01, kSsimC2 = 0.03 * 0.03;
constexpr double kLeastNorm = 1e-9;

void require_like_pictures(const Tensor& a, const Tensor& b) {
  if (a.dim() == 4 && a.sizes() == b.sizes() && a.numel() > 0) return;
  throw InputError(
      "", "",
      "pictures to compare must be [N, C, H, W] and alike, found " + nn::shape_text(a) + " and " + nn::shape_text(b));
}

// One axis of the window, [11].
Tensor ssim_kernel() {
  const Tensor x = torch::arange(kSsimWindow, torch::kFloat64) - static_cast<double>(kSsimWindow / 2);
  const Tensor g = torch::exp(x.square() * (-0.5 / (kSsimDeviation * kSsimDeviation)));
  return g / g.sum();
}

// The window is a product of two, so that two passes of 11 do what one of 121 does, and symmetric, so that the gradient
// is smoothed likewise: the library's backward pass of a convolution takes ten times as long.
class Smoothing : public torch::autograd::Function<Smoothing> {
 public:
  // @param planes [M, 1, H, W] @param kernel [11]
  static Tensor forward(torch::autograd::AutogradContext* context, const Tensor& planes, const Tensor& kernel) {
    context->save_for_backward({kernel});
    const std::vector<std::int64_t> one{1, 1}, down{kSsimWindow / 2, 0}, across{0, kSsimWindow / 2};
    const Tensor columns = at::conv2d(planes, kernel.view({1, 1, kSsimWindow, 1}), Tensor(), one, down);
    return at::conv2d(columns, kernel.view({1, 1, 1, kSsimWindow}), Tensor(), one, across);
  }
  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* context,
                                                 torch::autograd::variable_list gradients) {
    return {Smoothing::apply(gradients[0].contiguous(), context->get_saved_variables()[0]), Tensor()};
  }
};

}  // namespace

Tensor ssim_window() {
  const Tensor kernel = ssim_kernel();
  return torch::outer(kernel, kernel).to(torch::kFloat32);
}

Tensor ssim(const Tensor& a, const Tensor& b) {
  require_like_pictures(a, b);
  const std::int64_t items = a.size(0), height = a.size(2), width = a.size(3);
  const auto planes = [&](const Tensor& x) { return x.reshape({-1, 1, height, width}); };
  const Tensor pa = planes(a), pb = planes(b);
  const Tensor kernel = ssim_kernel().to(a.options());
  const Tensor smooth = Smoothing::apply(torch::cat({pa, pb, pa * pa, pb * pb, pa * pb}), kernel);
  const std::vector<Tensor> means = smooth.chunk(5);
  const Tensor &mu_a = means[0], &mu_b = means[1];
  const Tensor mu_aa = mu_a * mu_a, mu_bb = mu_b * mu_b, mu_ab = mu_a * mu_b;
  const Tensor var_a = means[2] - mu_aa, var_b = means[3] - mu_bb, covariance = means[4] - mu_ab;
  const Tensor map = ((2.0 * mu_ab + kSsimC1) * (2.0 * covariance + kSsimC2)) /
                     ((mu_aa + mu_bb + kSsimC1) * (var_a + var_b + kSsimC2));
  return map.reshape({items, -1}).mean(1);
}

Tensor psnr(const Tensor& a, const Tensor& b) { return -10.0 * torch::log10((a - b).square().mean()); }

Tensor normal_angle(const Tensor& a, const Tensor& b) {
  const Tensor na = 2.0 * a - 1.0, nb = 2.0 * b - 1.0;
  const Tensor norms = na.norm(2, -1) * nb.norm(2, -1);
  const Tensor usable = norms > kLeastNorm;
  if (!usable.any().item<bool>()) return (a.sum() + b.sum()) * 0.0;
  const Tensor cosine = ((na * nb).sum(-1) / (norms + kLeastNorm)).clamp(-1.0, 1.0);
  return torch::rad2deg(torch::acos(cosine.masked_select(usable))).mean();
}

PerceptualLoss perceptual_loss(const Tensor& a, const Tensor& b, const PerceptualOptions& options,
                               const PictureDistance& distance) {
  require_like_pictures(a, b);
  PerceptualLoss loss;
  loss.l1 = (a - b).abs().mean();
  loss.total = loss.l1;
  if (options.lambda_ssim != 0.0) {
    loss.ssim = 1.0 - ssim(a, b).mean();
    loss.total = loss.total + options.lambda_ssim * loss.ssim;
  }
  if (options.lambda_lpips != 0.0) {
    if (!distance) throw InputError("", "lambda_lpips", "there is no LPIPS network to compute this term with");
    loss.lpips = distance(a, b).mean();
    loss.total = loss.total + options.lambda_lpips * loss.lpips;
  }
  return loss;
}

}  // namespace anigen::models
