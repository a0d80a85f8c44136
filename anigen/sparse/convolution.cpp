#include "anigen/sparse/convolution.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <mutex>
#include <string>

#include "anigen/core/error.h"
#include "anigen/nn/kernels/activations.h"
#include "anigen/nn/kernels/mixed_products.h"
#include "anigen/nn/linear.h"
#include "anigen/nn/profile.h"

namespace anigen::sparse {

namespace {

constexpr std::int64_t kTaps = 27;

// Values that products by tensor operations gather at a time.
constexpr std::int64_t kMostGathered = std::int64_t{1} << 27;

// The links to one child: what they read lies side by side, so that one product serves them all, and the host waits
// for none.
struct ChildLinks {
  std::int64_t to_child = 0;
  Tensor taps, from_children, matrices;  // [K] int64, on the device

  std::int64_t count() const { return taps.size(0); }
  // Values at some neighbours of each row, absent ones 0: [N, K · Cin].
  // @param neighbours [27, N] @param filled `in` with a row of zeros below
  Tensor gathered(const TapPlan& plan, const Tensor& neighbours, const Tensor& filled) const {
    const Tensor found = neighbours.index_select(0, taps).to(torch::kInt64);
    const Tensor rows = found * plan.from_children + from_children.unsqueeze(1);
    const Tensor wanted = rows.masked_fill(found.lt(0), filled.size(0) - 1).t().reshape({-1});
    return filled.index_select(0, wanted).view({neighbours.size(1), count() * filled.size(1)});
  }
};

std::vector<ChildLinks> new_links_by_child(const TapPlan& plan, torch::Device device) {
  std::vector<ChildLinks> groups;
  for (std::size_t first = 0, last = 0; first < plan.links.size(); first = last) {
    std::vector<std::int64_t> taps, from_children, matrices;
    for (; last < plan.links.size() && plan.links[last].to_child == plan.links[first].to_child; ++last) {
      taps.push_back(plan.links[last].tap);
      from_children.push_back(plan.links[last].from_child);
      matrices.push_back(plan.links[last].matrix);
    }
    const auto on_device = [&](const std::vector<std::int64_t>& list) {
      return nn::to_device(torch::tensor(list, torch::kInt64), device);
    };
    groups.push_back({plan.links[first].to_child, on_device(taps), on_device(from_children), on_device(matrices)});
  }
  return groups;
}

// As above, from the last few that were made: networks have four plans, two each way.
std::vector<ChildLinks> links_by_child(const TapPlan& plan, torch::Device device) {
  struct Kept {
    std::vector<TapLink> links;
    torch::Device device;
    std::vector<ChildLinks> groups;
  };
  constexpr std::size_t kMostKept = 8;
  static std::mutex mutex;
  static auto* const kept = new std::deque<Kept>;  // a GPU's memory may be gone before this is
  const std::lock_guard<std::mutex> lock(mutex);
  for (const Kept& known : *kept) {
    if (known.device == device && known.links == plan.links) return known.groups;
  }
  kept->push_front({plan.links, device, new_links_by_child(plan, device)});
  if (kept->size() > kMostKept) kept->pop_back();
  return kept->front().groups;
}

Tensor with_zero_row(const Tensor& in) { return torch::cat({in, torch::zeros({1, in.size(1)}, in.options())}); }

// Calls body(first, count) for blocks of N rows whose gathered values are few enough.
template <typename Body>
void for_gathered_blocks(std::int64_t rows, std::int64_t values_per_row, const Body& body) {
  const std::int64_t block = std::max<std::int64_t>(1, kMostGathered / std::max<std::int64_t>(1, values_per_row));
  for (std::int64_t first = 0; first < rows; first += block) body(first, std::min(block, rows - first));
}

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

TapPlan plan_of(bool subdivide) { return subdivide ? subdivision_plan() : submanifold_plan(); }

// Operations of one product for each link of the plan that finds a neighbour; counted for a profile alone.
double tap_operations(const TapPlan& plan, const Tensor& neighbours, const Tensor& matrices) {
  if (!nn::is_profiled()) return 0.0;
  const Tensor found = neighbours.ge(0).sum(1);
  double pairs = 0.0;
  for (const TapLink& link : plan.links) pairs += static_cast<double>(found[link.tap].item<std::int64_t>());
  return 2.0 * pairs * static_cast<double>(matrices.size(1)) * static_cast<double>(matrices.size(2));
}

class TapFunction : public torch::autograd::Function<TapFunction> {
 public:
  static Tensor forward(AutogradContext* context, const Tensor& feats, const Tensor& matrices, const Tensor& bias,
                        const Tensor& neighbours, bool subdivide) {
    RECORD_USER_SCOPE("convolution: sparse");
    const bool rounded = nn::mixed_products() && nn::dtype_of(feats) == torch::kFloat32 && feats.is_cpu();
    const bool emulated = rounded && nn::emulated_mixed_products(), mixed = rounded && !emulated;
    const Tensor in = emulated ? nn::rounded_factor(feats) : feats;
    const Tensor factors = emulated ? nn::rounded_factor(matrices) : matrices;
    context->save_for_backward({in, factors, neighbours});
    context->saved_data["subdivide"] = subdivide;
    context->saved_data["mixed"] = mixed;
    context->saved_data["emulated"] = emulated;
    const TapPlan plan = plan_of(subdivide);
    Tensor out = torch::empty({neighbours.size(1) * plan.to_children, matrices.size(2)}, matrices.options());
    out.copy_(bias);
    nn::count_operations(tap_operations(plan, neighbours, matrices), mixed);
    add_tap_product(plan, neighbours, in, factors, out, mixed);
    return out.to(nn::dtype_of(feats));
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    RECORD_USER_SCOPE("convolution: sparse");
    const torch::autograd::variable_list saved = nn::saved_once(*context, "a sparse convolution");
    const Tensor &feats = saved[0], &matrices = saved[1], &neighbours = saved[2], &given = gradients[0];
    const Tensor slopes = context->saved_data["emulated"].toBool() ? nn::rounded_factor(given) : given;
    const TapPlan plan = plan_of(context->saved_data["subdivide"].toBool());
    const bool mixed = context->saved_data["mixed"].toBool();
    Tensor d_feats, d_matrices, d_bias;
    const int products = (context->needs_input_grad(0) ? 1 : 0) + (context->needs_input_grad(1) ? 1 : 0);
    nn::count_operations(products * tap_operations(plan, neighbours, matrices), mixed);
    if (context->needs_input_grad(0)) {
      Tensor sums = torch::zeros(feats.sizes(), matrices.options());
      add_tap_product(reversed(plan), neighbours, slopes, matrices.transpose(1, 2), sums, mixed);
      d_feats = sums.to(nn::dtype_of(feats));
    }
    if (context->needs_input_grad(1)) d_matrices = tap_correlation(plan, neighbours, feats, slopes, mixed);
    if (context->needs_input_grad(2)) d_bias = nn::sum_of_rows(given.to(nn::dtype_of(matrices)));
    return {d_feats, d_matrices, d_bias, Tensor(), Tensor()};
  }
};

// @param feats [N, Cin] @param matrices [27, Cin, Cout], or with `subdivide` [64, Cin, Cout] (submanifold_plan,
// subdivision_plan) @param bias [Cout]; both in the type that sums of feats are formed in
// @param neighbours [27, N] int32, on the device of feats @return [N, Cout], or with `subdivide` [8 N, Cout]; the dtype
// of feats
Tensor tap_function(const Tensor& feats, const Tensor& matrices, const Tensor& bias, const Tensor& neighbours,
                    bool subdivide) {
  return TapFunction::apply(feats, matrices, bias, neighbours, subdivide);
}

constexpr std::int64_t kKernel = 3, kKernelTaps = kKernel * kKernel * kKernel;

void check_convolution(const Support& support, const Tensor& feats, const Tensor& weight, const Tensor& bias) {
  TORCH_CHECK(weight.dim() == 5 && weight.size(1) == kKernel && weight.size(2) == kKernel &&
                  weight.size(3) == kKernel && feats.dim() == 2 && feats.size(0) == support.size() &&
                  feats.size(1) == weight.size(4) && weight.size(0) > 0 && weight.size(4) > 0,
              "sparse convolution at ", support.size(), " voxels of features ", nn::shape_text(feats), " by a weight ",
              nn::shape_text(weight));
  TORCH_CHECK(!bias.defined() || (bias.dim() == 1 && bias.size(0) == weight.size(0)), "sparse convolution by a weight ",
              nn::shape_text(weight), " and a bias ", nn::shape_text(bias));
  TORCH_CHECK(nn::dtype_of(feats) == nn::dtype_of(weight) && feats.is_floating_point(),
              "sparse convolution of features of type ", feats.dtype(), " by a weight of type ", weight.dtype());
}

Tensor widened(const Tensor& x) { return x.to(nn::accumulation_dtype(nn::dtype_of(x))); }

Tensor wide_bias(const Tensor& bias, const Tensor& weight) {
  return widened(bias.defined() ? bias : torch::zeros({weight.size(0)}, weight.options()));
}

// [27, Cin, Cout], tap by tap.
Tensor matrices_of_taps(const Tensor& weight) {
  return weight.reshape({weight.size(0), kKernelTaps, weight.size(4)}).permute({1, 2, 0});
}

// Taps along one axis, [.., 3, ..] → [.., 4, ..]: for the lower child the tap that meets the coarse voxel before its
// own and the sum of those that meet its own, then for the upper child its own and the next.
Tensor folded_axis(const Tensor& taps, std::int64_t axis) {
  const std::vector<Tensor> tap = taps.unbind(axis);
  return torch::stack({tap[0], tap[1] + tap[2], tap[0] + tap[1], tap[2]}, axis);
}

// [Cout, 3, 3, 3, Cin] → [64, Cin, Cout] of subdivision_plan. Sums, not a product by a matrix of zeros and ones: a
// library may order the sums of a product by the number of its threads.
Tensor folded_taps(const Tensor& weight) {
  Tensor taps = weight.permute({1, 2, 3, 4, 0});
  for (std::int64_t axis = 0; axis < 3; ++axis) taps = folded_axis(taps, axis);
  const std::int64_t in = weight.size(4), out = weight.size(0);
  return taps.reshape({2, 2, 2, 2, 2, 2, in, out}).permute({0, 2, 4, 1, 3, 5, 6, 7}).reshape({64, in, out});
}

}  // namespace

TapPlan submanifold_plan() {
  TapPlan plan;
  for (std::int64_t tap = 0; tap < kTaps; ++tap) plan.links.push_back({tap, 0, 0, tap});
  return plan;
}

TapPlan subdivision_plan() {
  TapPlan plan;
  plan.to_children = 8;
  for (std::int64_t child = 0; child < 8; ++child) {
    for (std::int64_t side = 0; side < 8; ++side) {
      // Along an axis, bit 0 of a child sees the voxel before its own and its own, bit 1 its own and the next.
      const std::int64_t x = child / 4 + side / 4, y = child / 2 % 2 + side / 2 % 2, z = child % 2 + side % 2;
      plan.links.push_back({(x * 3 + y) * 3 + z, 0, child, child * 8 + side});
    }
  }
  return plan;
}

TapPlan reversed(const TapPlan& plan) {
  TapPlan back;
  back.from_children = plan.to_children;
  back.to_children = plan.from_children;
  for (const TapLink& link : plan.links) {
    back.links.push_back({kTaps - 1 - link.tap, link.to_child, link.from_child, link.matrix});
  }
  std::stable_sort(back.links.begin(), back.links.end(),
                   [](const TapLink& a, const TapLink& b) { return a.to_child < b.to_child; });
  return back;
}

void add_tensor_tap_product(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& matrices,
                            Tensor& out) {
  const Tensor weights = matrices.to(nn::dtype_of(in)), filled = with_zero_row(in);
  const std::int64_t rows = neighbours.size(1), in_channels = in.size(1), out_channels = out.size(1);
  const Tensor by_child = out.view({rows, plan.to_children, out_channels});
  for (const ChildLinks& links : links_by_child(plan, in.device())) {
    const std::int64_t width = links.count() * in_channels;
    const Tensor stacked = weights.index_select(0, links.matrices).reshape({width, out_channels});
    const Tensor sums = by_child.select(1, links.to_child);
    for_gathered_blocks(rows, width, [&](std::int64_t first, std::int64_t count) {
      const Tensor product = links.gathered(plan, neighbours.narrow(1, first, count), filled).mm(stacked);
      sums.narrow(0, first, count).add_(product.to(nn::dtype_of(out)));
    });
  }
}

Tensor tensor_tap_correlation(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& slopes) {
  const std::int64_t rows = neighbours.size(1), in_channels = in.size(1), out_channels = slopes.size(1);
  const auto wide = in.options().dtype(nn::accumulation_dtype(nn::dtype_of(in)));
  Tensor matrices = torch::empty({plan.matrices(), in_channels, out_channels}, wide);
  const Tensor filled = with_zero_row(in), by_child = slopes.reshape({rows, plan.to_children, out_channels});
  for (const ChildLinks& links : links_by_child(plan, in.device())) {
    const std::int64_t width = links.count() * in_channels;
    const Tensor of_child = by_child.select(1, links.to_child), sums = torch::zeros({width, out_channels}, wide);
    for_gathered_blocks(rows, width, [&](std::int64_t first, std::int64_t count) {
      const Tensor values = links.gathered(plan, neighbours.narrow(1, first, count), filled);
      sums.add_(values.t().mm(of_child.narrow(0, first, count)));
    });
    matrices.index_copy_(0, links.matrices, sums.view({links.count(), in_channels, out_channels}));
  }
  return matrices;
}

void add_tap_product(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& matrices,
                     Tensor& out, bool mixed) {
  if (!in.is_cpu()) return add_tensor_tap_product(plan, neighbours, in, matrices, out);
  // The matrices of a subdivision are sums of weights, which a model in bf16 would round once more.
  const bool plain = plan.from_children == 1 && plan.to_children == 1;
  const bool narrow = mixed || (plain && nn::dtype_of(in) == torch::kBFloat16);
  if (narrow && fits_bf16_tap_product(matrices))
    return add_bf16_tap_product(plan, neighbours, in.to(torch::kBFloat16), matrices, out);
  const torch::Dtype dtype = nn::dtype_of(out);
  add_cpu_tap_product(plan, neighbours, in.to(dtype), matrices.to(dtype), out);
}

Tensor tap_correlation(const TapPlan& plan, const Tensor& neighbours, const Tensor& in, const Tensor& slopes,
                       bool mixed) {
  if (!in.is_cpu()) return tensor_tap_correlation(plan, neighbours, in, slopes);
  const torch::Dtype dtype = nn::accumulation_dtype(nn::dtype_of(in));
  return cpu_tap_correlation(plan, neighbours, in.to(dtype), slopes.to(dtype), mixed);
}

Tensor submanifold_convolution(const Support& support, const Tensor& feats, const Tensor& weight, const Tensor& bias) {
  check_convolution(support, feats, weight, bias);
  return tap_function(feats, matrices_of_taps(widened(weight)), wide_bias(bias, weight),
                      support.neighbours_on(feats.device()), false);
}

Tensor subdivided_convolution(const Support& support, const Tensor& feats, const Tensor& weight, const Tensor& bias) {
  check_convolution(support, feats, weight, bias);
  support.subdivided();  // whether it can be
  return tap_function(feats, folded_taps(widened(weight)), wide_bias(bias, weight),
                      support.neighbours_on(feats.device()), true);
}

SubmanifoldKernelImpl::SubmanifoldKernelImpl(std::int64_t in_channels, std::int64_t out_channels, std::int64_t kernel) {
  if (kernel != 1 && kernel != kKernel)
    throw NotSupportedError("", "", "a sparse convolution with a kernel of " + std::to_string(kernel) + " voxels");
  weight = register_parameter("weight", torch::empty({out_channels, kernel, kernel, kernel, in_channels}));
  bias = register_parameter("bias", torch::empty({out_channels}));
}

SparseTensor SubmanifoldKernelImpl::forward(const SparseTensor& x) {
  if (weight.size(1) == kKernel) return x.with(submanifold_convolution(*x.support, x.feats, weight, bias));
  const Tensor matrix = weight.reshape({weight.size(4), weight.size(0)});
  if (x.feats.is_cpu() && nn::dtype_of(x.feats) == torch::kHalf) {  // not every LibTorch multiplies these
    return x.with(torch::addmm(widened(bias), widened(x.feats), widened(matrix)).to(torch::kHalf));
  }
  if (nn::prefers_mixed_linear(x.feats, matrix.t())) return x.with(nn::mixed_linear(x.feats, matrix.t(), bias));
  return x.with(torch::addmm(bias, x.feats, matrix));
}

SubmanifoldConv3dImpl::SubmanifoldConv3dImpl(std::int64_t in_channels, std::int64_t out_channels, std::int64_t kernel) {
  conv = register_module("conv", SubmanifoldKernel(in_channels, out_channels, kernel));
}

SparseTensor SubmanifoldConv3dImpl::forward(const SparseTensor& x) { return conv->forward(x); }

void default_submanifold_kernels(torch::nn::Module& module) {
  module.apply([](torch::nn::Module& part) {
    auto* kernel = part.as<SubmanifoldKernelImpl>();
    if (kernel == nullptr) return;
    const double fan_in = static_cast<double>(kernel->weight.numel() / kernel->weight.size(0));
    const double bound = 1.0 / std::sqrt(fan_in);  // √(6 / ((1 + a²) fan-in)) with a = √5
    torch::nn::init::uniform_(kernel->weight, -bound, bound);
    torch::nn::init::uniform_(kernel->bias, -bound, bound);
  });
}

}  // namespace anigen::sparse
