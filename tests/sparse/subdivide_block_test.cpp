#include "anigen/sparse/blocks.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "tests/sparse/attention_cases.h"

namespace anigen::sparse {
namespace {

SubdivideBlockOptions block_options(std::int64_t channels, std::int64_t out_channels) {
  SubdivideBlockOptions options;
  options.channels = channels;
  options.out_channels = out_channels;
  options.groups = 2;
  return options;
}

// The published order of operations: everything is subdivided first, features repeated.
Tensor written_out(const SubdivideBlockOptions& options, torch::nn::Module& block, const SparseTensor& x) {
  const auto parameters = block.named_parameters();
  const auto norm = [&](const SparseTensor& in, const std::string& name) {
    return in.with(torch::silu(sparse_group_norm(in.feats, in.support->items(), parameters[name + ".weight"],
                                                 parameters[name + ".bias"], options.groups, 1e-5)));
  };
  const auto convolution = [&](const SparseTensor& in, const std::string& name) {
    return in.with(submanifold_convolution(*in.support, in.feats, parameters[name + ".conv.weight"],
                                           parameters[name + ".conv.bias"]));
  };
  SparseTensor h = norm(x, "act_layers.0"), skip = x;
  if (options.subdivide) {
    h = subdivide(h);
    skip = subdivide(skip);
  }
  h = norm(convolution(h, "out_layers.0"), "out_layers.1");
  h = convolution(h, "out_layers.3");
  if (!parameters.contains("skip_connection.conv.weight")) return h.feats + skip.feats;
  const Tensor matrix = parameters["skip_connection.conv.weight"].reshape({options.channels, options.out_channels});
  return h.feats + torch::addmm(parameters["skip_connection.conv.bias"], skip.feats, matrix);
}

TEST(SubdivideBlock, KeysInPublishedOrder) {
  const std::vector<std::string> keys{
      "act_layers.0.weight",         "act_layers.0.bias",        "out_layers.0.conv.weight", "out_layers.0.conv.bias",
      "out_layers.1.weight",         "out_layers.1.bias",        "out_layers.3.conv.weight", "out_layers.3.conv.bias",
      "skip_connection.conv.weight", "skip_connection.conv.bias"};
  EXPECT_EQ(cases::parameter_keys(*SubdivideBlock(block_options(4, 6))), keys);
  SubdivideBlockOptions same = block_options(4, 4);
  const std::vector<std::string> without(keys.begin(), keys.end() - 2);
  EXPECT_EQ(cases::parameter_keys(*SubdivideBlock(same)), without);
  same.skip_convolution = true;
  EXPECT_EQ(cases::parameter_keys(*SubdivideBlock(same)), keys);
}

TEST(SubdivideBlock, IsThePublishedSequence) {
  torch::manual_seed(51);
  const SparseTensor x = cases::random_sparse({40, 0, 25}, 5, 6, torch::kFloat64);
  for (const bool subdivide : {true, false}) {
    for (const std::int64_t out : {6, 10}) {
      SubdivideBlockOptions options = block_options(6, out);
      options.subdivide = subdivide;
      SubdivideBlock block(options);
      cases::draw_parameters(*block, torch::kFloat64);
      const SparseTensor y = block->forward(x);
      EXPECT_EQ(y.support, subdivide ? x.support->subdivided() : x.support);
      EXPECT_LT(cases::distance(y.feats, written_out(options, *block, x)), 1e-10);
      const torch::NoGradGuard no_grad;  // takes shortcuts
      EXPECT_LT(cases::distance(block->forward(x).feats, y.feats), 1e-12);
    }
  }
}

TEST(SubdivideBlock, GradientsReachEveryParameterAndTheInput) {
  for (const torch::Dtype dtype : {torch::kFloat64, torch::kFloat32}) {  // the latter by kernels
    torch::manual_seed(52);
    SparseTensor x = cases::random_sparse({30, 10}, 4, 6, dtype);
    x.feats.requires_grad_();
    SubdivideBlock block(block_options(6, 4));
    cases::draw_parameters(*block, dtype);
    std::vector<Tensor> inputs = block->parameters();
    inputs.push_back(x.feats);
    const Tensor y = block->forward(x).feats, direction = torch::randn_like(y);
    const std::vector<Tensor> found = torch::autograd::grad({y}, inputs, {direction});
    const std::vector<Tensor> wanted =
        torch::autograd::grad({written_out(block_options(6, 4), *block, x)}, inputs, {direction});
    const double limit = dtype == torch::kFloat64 ? 1e-9 : 1e-4;
    for (std::size_t i = 0; i < found.size(); ++i)
      EXPECT_LT(cases::distance(found[i], wanted[i]), limit * (1.0 + wanted[i].abs().max().item<double>())) << i;
  }
}

TEST(SubdivideBlock, BeginsAsItsSkip) {
  torch::manual_seed(53);
  const SparseTensor x = cases::random_sparse({30}, 5, 4);
  SubdivideBlock block(block_options(4, 4));
  default_submanifold_kernels(*block);
  default_group_norms(*block);
  block->initialize();
  EXPECT_TRUE(torch::equal(block->forward(x).feats, subdivide(x).feats));
  EXPECT_EQ(block->dtype(), torch::kFloat32);
}

TEST(SubdivideBlock, SixteenBitConvolutionsKeepTheNorms) {
  torch::manual_seed(54);
  const SparseTensor x = cases::random_sparse({30}, 5, 4);
  SubdivideBlock block(block_options(4, 6));
  default_submanifold_kernels(*block);
  default_group_norms(*block);
  const torch::NoGradGuard no_grad;
  const Tensor wanted = block->forward(x).feats;
  nn::cast_linears(*block, torch::kBFloat16);
  EXPECT_EQ(block->dtype(), torch::kBFloat16);
  EXPECT_EQ(block->named_parameters()["out_layers.1.weight"].scalar_type(), torch::kFloat32);
  const Tensor found = block->forward(x.with(x.feats.to(torch::kBFloat16))).feats;
  EXPECT_EQ(found.scalar_type(), torch::kBFloat16);
  EXPECT_LT(cases::distance(found, wanted), 0.1);  // values of a few units, each rounded to 2⁻⁸ of itself some times
}

TEST(SubdivideBlock, NoVoxels) {
  SubdivideBlock block(block_options(4, 6));
  default_submanifold_kernels(*block);
  default_group_norms(*block);
  const SparseTensor x{Support::create(torch::zeros({0, 4}, torch::kInt32), 2), torch::zeros({0, 4})};
  EXPECT_EQ(block->forward(x).feats.sizes(), (std::vector<std::int64_t>{0, 6}));
}

}  // namespace
}  // namespace anigen::sparse
