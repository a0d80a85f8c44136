#include "anigen/nn/volumes.h"

#include <ATen/Parallel.h>
#include <algorithm>

#include "anigen/nn/kernels/mixed_products.h"
#include "anigen/nn/kernels/rows.h"
#include "anigen/nn/kernels/tiles.h"
#include "anigen/nn/kernels/volume_convolution.h"
#include "anigen/nn/kernels/volume_convolution_bf16.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/norms.h"
#include "anigen/nn/profile.h"

namespace anigen::nn {

Tensor patchify(const Tensor& volume, std::int64_t patch) {
  TORCH_CHECK(volume.dim() == 5, "patchify: a volume has the shape [B, C, X, Y, Z], not ", volume.sizes());
  const std::int64_t b = volume.size(0), c = volume.size(1), p = patch;
  const std::int64_t x = volume.size(2), y = volume.size(3), z = volume.size(4);
  TORCH_CHECK(p > 0 && x % p == 0 && y % p == 0 && z % p == 0, "patchify: ", volume.sizes(),
              " does not divide into patches of ", p);
  const Tensor split = volume.reshape({b, c, x / p, p, y / p, p, z / p, p});
  return split.permute({0, 1, 3, 5, 7, 2, 4, 6}).reshape({b, c * p * p * p, x / p, y / p, z / p});
}

Tensor pixel_shuffle_3d(const Tensor& volume, std::int64_t scale) {
  TORCH_CHECK(volume.dim() == 5, "pixel shuffle: a volume has the shape [B, C, X, Y, Z], not ", volume.sizes());
  const std::int64_t b = volume.size(0), s = scale, cells = s * s * s;
  const std::int64_t x = volume.size(2), y = volume.size(3), z = volume.size(4);
  TORCH_CHECK(s > 0 && volume.size(1) % cells == 0, "pixel shuffle: ", volume.size(1),
              " channels are not a multiple of ", cells);
  const std::int64_t c = volume.size(1) / cells;
  const Tensor split = volume.reshape({b, c, s, s, s, x, y, z});
  if (volume.suggest_memory_format() == torch::MemoryFormat::ChannelsLast3d) {
    return split.permute({0, 5, 2, 6, 3, 7, 4, 1}).reshape({b, x * s, y * s, z * s, c}).permute({0, 4, 1, 2, 3});
  }
  return split.permute({0, 1, 5, 2, 6, 3, 7, 4}).reshape({b, c, x * s, y * s, z * s});
}

Tensor unpatchify(const Tensor& patches, std::int64_t patch) { return pixel_shuffle_3d(patches, patch); }

namespace {

using kernels::VolumeConvolutionSizes;
VolumeConvolutionSizes convolution_sizes(const Tensor& x, const Tensor& weight) {
  return {x.size(0), x.size(2), x.size(3), x.size(4), weight.size(1), weight.size(0)};
}

Tensor channels_last(const Tensor& x) { return x.contiguous(torch::MemoryFormat::ChannelsLast3d); }

Tensor empty_volume(const Tensor& like, std::int64_t channels) {
  return torch::empty({like.size(0), channels, like.size(2), like.size(3), like.size(4)}, like.options(),
                      torch::MemoryFormat::ChannelsLast3d);
}

// Weights as the kernels read them: bf16 for mixed products, else fp32. @param sizes of the layer @param transposed
// those of the gradient of the input, for sizes.transposed()
Tensor packed_weights(const VolumeConvolutionSizes& sizes, const Tensor& weight, bool transposed, bool mixed) {
  const VolumeConvolutionSizes packed_sizes = transposed ? sizes.transposed() : sizes;
  const Tensor dense = weight.contiguous();
  const float* data = dense.data_ptr<float>();
  if (!mixed) {
    Tensor packed = torch::empty({packed_sizes.weights()}, weight.options());
    const auto pack = transposed ? kernels::pack_transposed_volume_weights : kernels::pack_volume_weights;
    pack(data, sizes, packed.data_ptr<float>());
    return packed;
  }
  constexpr std::int64_t kGrain = 8;
  const auto pack = transposed ? kernels::pack_transposed_volume_weights_bf16 : kernels::pack_volume_weights_bf16;
  Tensor packed = torch::empty({kernels::bf16_volume_weights(packed_sizes)}, weight.options().dtype(torch::kBFloat16));
  std::uint16_t* packed_data = bf16_bits(packed);
  at::parallel_for(0, kernels::channel_pairs(packed_sizes), kGrain,
                   [&](std::int64_t begin, std::int64_t end) { pack(data, sizes, packed_data, begin, end); });
  return packed;
}

// @param x channels last @param packed of packed_weights() @param bias of whole vectors of output channels
Tensor convolve(const VolumeConvolutionSizes& sizes, const Tensor& x, const Tensor& packed, const Tensor& bias) {
  Tensor out = empty_volume(x, sizes.out);
  const bool mixed = dtype_of(packed) == torch::kBFloat16;
  const float *x_data = x.data_ptr<float>(), *bias_data = bias.data_ptr<float>();
  float* out_data = out.data_ptr<float>();
  at::parallel_for(0, sizes.slabs(), 1, [&](std::int64_t begin, std::int64_t end) {
    if (mixed) {
      kernels::convolve_slabs_bf16(sizes, x_data, bf16_bits(packed), bias_data, out_data, begin, end);
    } else {
      kernels::convolve_slabs(sizes, x_data, packed.data_ptr<float>(), bias_data, out_data, begin, end);
    }
  });
  return out;
}

struct ParameterGradients {
  Tensor weight, bias;
};

// Into how many chunks the slabs are cut, each with sums of its own that are added up in order: the sizes decide alone,
// so that any number of threads gives the same bits. Many for balance, as long as the sums stay in a cache; fewer than
// eight only where they would take more than 256 MiB, or where chunks would have so few voxels that to clear and to add
// up their sums would be a good part of the work.
std::int64_t gradient_chunks(const VolumeConvolutionSizes& sizes, std::int64_t floats) {
  constexpr std::int64_t kMost = 32, kUsual = 8, kCached = 1 << 20, kAffordable = 1 << 26, kFewestVoxels = 256;
  const std::int64_t slabs = sizes.slabs(), voxels = slabs * sizes.y * sizes.z;
  const std::int64_t wanted = std::min(kMost, std::max(kUsual, kCached / floats));
  const std::int64_t most = std::max<std::int64_t>(1, std::min(kAffordable / floats, voxels / kFewestVoxels));
  return std::min({slabs, wanted, most});
}

// The sums of all chunks, a part of them after the other so that each is read once.
Tensor added_up(const Tensor& sums) {
  constexpr std::int64_t kGrain = 8192;
  const std::int64_t chunks = sums.size(0), floats = sums.size(1);
  if (chunks == 1) return sums[0];
  const Tensor total = torch::empty({floats}, sums.options());
  const float* const from = sums.data_ptr<float>();
  float* const to = total.data_ptr<float>();
  at::parallel_for(0, floats, kGrain, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t part = begin; part < end; part += kGrain) {
      const std::int64_t last = std::min(end, part + kGrain);
      std::copy(from + part, from + last, to + part);
      for (std::int64_t chunk = 1; chunk < chunks; ++chunk) {
        for (std::int64_t i = part; i < last; ++i) to[i] += from[chunk * floats + i];
      }
    }
  });
  return total;
}

ParameterGradients parameter_gradients(const VolumeConvolutionSizes& sizes, const Tensor& x, const Tensor& dy,
                                       bool mixed) {
  const auto add_gradient = mixed ? kernels::add_weight_gradient_bf16 : kernels::add_weight_gradient;
  const std::int64_t channels = sizes.padded_out(), floats = sizes.weights() + channels;
  const std::int64_t chunks = gradient_chunks(sizes, floats);
  const Tensor sums = torch::empty({chunks, floats}, x.options());
  const float *x_data = x.data_ptr<float>(), *dy_data = dy.data_ptr<float>();
  float* sums_data = sums.data_ptr<float>();
  at::parallel_for(0, chunks, 1, [&](std::int64_t begin, std::int64_t end) {
    for (std::int64_t chunk = begin; chunk < end; ++chunk) {
      float* weight_sums = sums_data + chunk * floats;
      std::fill_n(weight_sums, floats, 0.0F);  // here, where it stays in the thread's cache
      add_gradient(sizes, x_data, dy_data, sizes.slabs() * chunk / chunks, sizes.slabs() * (chunk + 1) / chunks,
                   weight_sums, weight_sums + sizes.weights());
    }
  });
  const Tensor total = added_up(sums);
  const Tensor weight = total.narrow(0, 0, sizes.weights()).view({3, 3, 3, sizes.in, channels});
  return {weight.narrow(4, 0, sizes.out).permute({4, 3, 0, 1, 2}).contiguous(),
          total.narrow(0, sizes.weights(), sizes.out).clone()};
}

// Of one product, borders included.
double tap_operations(const VolumeConvolutionSizes& sizes) {
  return 2.0 * 27.0 * static_cast<double>(sizes.slabs() * sizes.y * sizes.z) *
         static_cast<double>(sizes.in * sizes.out);
}

class VolumeConvolution : public torch::autograd::Function<VolumeConvolution> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& x, const Tensor& weight, const Tensor& bias) {
    RECORD_USER_SCOPE("convolution: volumes");
    const VolumeConvolutionSizes sizes = convolution_sizes(x, weight);
    const bool emulated = emulated_mixed_products(), mixed = mixed_products() && !emulated;
    const Tensor values = emulated ? rounded_factor(channels_last(x)) : channels_last(x);
    const Tensor factors = emulated ? rounded_factor(weight) : weight;
    Tensor padded_bias = torch::zeros({sizes.padded_out()}, x.options());
    padded_bias.narrow(0, 0, sizes.out).copy_(bias);
    context->save_for_backward({emulated ? values : x, factors});
    context->saved_data["mixed"] = mixed;
    context->saved_data["emulated"] = emulated;
    count_operations(tap_operations(sizes), mixed);
    return convolve(sizes, values, packed_weights(sizes, factors, false, mixed), padded_bias);
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("convolution: volumes");
    const variable_list saved = saved_once(*context, "volume convolution");
    const Tensor &x = saved[0], &weight = saved[1];
    const VolumeConvolutionSizes sizes = convolution_sizes(x, weight);
    const bool mixed = context->saved_data["mixed"].toBool();  // backward as forward
    const bool emulated = context->saved_data["emulated"].toBool();
    const Tensor slopes = channels_last(gradients[0]), dy = emulated ? rounded_factor(slopes) : slopes;
    Tensor dx;
    const int products = (context->needs_input_grad(0) ? 1 : 0) + (context->needs_input_grad(1) ? 1 : 0);
    count_operations(products * tap_operations(sizes), mixed);
    if (context->needs_input_grad(0)) {
      const VolumeConvolutionSizes back = sizes.transposed();
      dx = convolve(back, dy, packed_weights(sizes, weight, true, mixed),
                    torch::zeros({back.padded_out()}, x.options()));
    }
    ParameterGradients parameters;
    if (context->needs_input_grad(1) || context->needs_input_grad(2))
      parameters = parameter_gradients(sizes, channels_last(x), dy, mixed);
    if (emulated) parameters.bias = slopes.sum(c10::IntArrayRef{0, 2, 3, 4});  // no product, so nothing is rounded
    return {dx, parameters.weight, parameters.bias};
  }
};

bool is_fp32_volume(const Tensor& x, const Tensor& weight) {
  const bool plain = x.is_cpu() && weight.is_cpu() && x.layout() == torch::kStrided && dtype_of(x) == torch::kFloat32 &&
                     dtype_of(weight) == torch::kFloat32;
  return plain && x.dim() == 5 && weight.dim() == 5 && x.size(1) == weight.size(1) && x.numel() > 0 &&
         weight.numel() > 0;
}

bool has_kernel(const Tensor& weight, std::int64_t edge) {
  return weight.size(2) == edge && weight.size(3) == edge && weight.size(4) == edge;
}

constexpr double kEps = 1e-5;

// body([..., C], channels of a voxel side by side) of a volume [B, C, X, Y, Z], in its memory format.
template <typename Body>
Tensor by_voxel(const Tensor& x, const Body& body) {
  return body(x.movedim(1, -1)).movedim(-1, 1).contiguous(x.suggest_memory_format());
}

}  // namespace

bool volume_convolution_supports(const Tensor& x, const Tensor& weight, std::int64_t stride, std::int64_t padding) {
  return stride == 1 && padding == 1 && is_fp32_volume(x, weight) && has_kernel(weight, 3);
}

Tensor volume_convolution(const Tensor& x, const Tensor& weight, const Tensor& bias) {
  TORCH_CHECK(volume_convolution_supports(x, weight, 1, 1), "volume convolution: an fp32 volume on a CPU and a 3³ ",
              "kernel are needed, not ", x.sizes(), " ", dtype_of(x), " and ", weight.sizes(), " ", dtype_of(weight));
  TORCH_CHECK(bias.dim() == 1 && bias.size(0) == weight.size(0) && dtype_of(bias) == torch::kFloat32,
              "volume convolution: a bias of ", weight.size(0), " fp32 values is needed, not ", bias.sizes());
  return VolumeConvolution::apply(x, weight, bias);
}

bool patch_convolution_supports(const Tensor& x, const Tensor& weight, std::int64_t stride, std::int64_t padding) {
  if (padding != 0 || stride < 1 || !is_fp32_volume(x, weight) || !has_kernel(weight, stride)) return false;
  return x.size(2) % stride == 0 && x.size(3) % stride == 0 && x.size(4) % stride == 0;
}

Tensor patch_convolution(const Tensor& x, const Tensor& weight, const Tensor& bias) {
  const std::int64_t k = weight.size(2), b = x.size(0), c = x.size(1);
  TORCH_CHECK(patch_convolution_supports(x, weight, k, 0), "patch convolution: ", x.sizes(), " and ", weight.sizes(),
              " do not fit");
  const std::int64_t nx = x.size(2) / k, ny = x.size(3) / k, nz = x.size(4) / k;
  const Tensor cells = x.permute({0, 2, 3, 4, 1}).reshape({b, nx, k, ny, k, nz, k, c});
  const Tensor rows = cells.permute({0, 1, 3, 5, 2, 4, 6, 7}).reshape({b * nx * ny * nz, k * k * k * c});
  const Tensor matrix = weight.permute({0, 2, 3, 4, 1}).reshape({weight.size(0), k * k * k * c});
  return linear(rows, matrix, bias).view({b, nx, ny, nz, weight.size(0)}).permute({0, 4, 1, 2, 3});
}

Conv3dImpl::Conv3dImpl(std::int64_t in_channels, std::int64_t out_channels, std::int64_t kernel, std::int64_t stride,
                       std::int64_t padding)
    : stride_(stride), padding_(padding) {
  weight = register_parameter("weight", torch::empty({out_channels, in_channels, kernel, kernel, kernel}));
  bias = register_parameter("bias", torch::empty({out_channels}));
}

Tensor Conv3dImpl::forward(const Tensor& x) {
  if (volume_convolution_supports(x, weight, stride_, padding_)) return volume_convolution(x, weight, bias);
  if (patch_convolution_supports(x, weight, stride_, padding_)) return patch_convolution(x, weight, bias);
  return torch::conv3d(x, weight, bias, {stride_, stride_, stride_}, {padding_, padding_, padding_});
}

VolumeNormImpl::VolumeNormImpl(std::int64_t channels, Kind kind, std::int64_t groups) : kind_(kind), groups_(groups) {
  TORCH_CHECK(kind == Kind::kLayer || (groups > 0 && channels % groups == 0), "group norm: ", channels,
              " channels do not divide into ", groups, " groups");
  weight = register_parameter("weight", torch::empty({channels}));
  bias = register_parameter("bias", torch::empty({channels}));
}

Tensor VolumeNormImpl::group_norm(const Tensor& x) const {
  const torch::Dtype dtype = dtype_of(x), wide = accumulation_dtype(dtype);
  return torch::group_norm(x.to(wide).contiguous(), groups_, weight.to(wide), bias.to(wide), kEps).to(dtype);
}

Tensor VolumeNormImpl::forward(const Tensor& x) {
  if (kind_ == Kind::kGroup) return group_norm(x);
  return by_voxel(x, [&](const Tensor& rows) { return affine_norm(rows, weight, bias, kEps); });
}

Tensor VolumeNormImpl::activated(const Tensor& x) {
  if (kind_ == Kind::kGroup) return torch::silu(group_norm(x));
  return by_voxel(x, [&](const Tensor& rows) { return norm_silu(rows, weight, bias, kEps); });
}

}  // namespace anigen::nn
