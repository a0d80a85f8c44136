#include <gtest/gtest.h>

#include "anigen/train/distributed/gradient_buckets.h"
#include "tests/train/distributed/joined_ranks.h"

namespace anigen::train {
namespace {

using torch::Tensor;

constexpr int kLayers = 6;

/// Layers that are used in turn; every call can leave one out.
struct NetImpl : torch::nn::Module {
  NetImpl() {
    for (int i = 0; i < kLayers; ++i) {
      layers.push_back(register_module("layer" + std::to_string(i), torch::nn::Linear(8, 8)));
      const torch::NoGradGuard no_grad;
      layers.back()->weight.copy_((torch::arange(64).view({8, 8}) * (0.31 + i)).sin());
      layers.back()->bias.fill_(0.1 * i);
    }
  }
  Tensor forward(Tensor x, int left_out) {
    for (int i = 0; i < kLayers; ++i) {
      if (i != left_out) x = torch::tanh(layers[static_cast<std::size_t>(i)]->forward(x));
    }
    return x.to(torch::kFloat32).square().mean();
  }
  std::vector<torch::nn::Linear> layers;
};

Tensor input(int rank, int step, int micro_batch, torch::Dtype dtype) {
  return (torch::arange(32, torch::kFloat64).view({4, 8}) * (0.7 + rank + 0.1 * step + 0.01 * micro_batch))
      .cos()
      .to(dtype);
}

struct BucketCase {
  int ranks, copies;
  torch::Dtype dtype;
};

// Steps of two micro-batches per copy; on some ranks the last pass of a step leaves a layer out.
void compare_with_a_sum_afterwards(Communicator& ranks, const BucketCase& how) {
  std::vector<std::shared_ptr<NetImpl>> nets;
  for (int copy = 0; copy < how.copies; ++copy) nets.push_back(std::make_shared<NetImpl>());
  std::vector<ParameterBuffer> buffers;
  buffers.reserve(nets.size());
  buffers.emplace_back(std::vector<nn::NamedModel>{{"net", nets.front()}}, [&] { nets.front()->to(how.dtype); });
  for (std::size_t copy = 1; copy < nets.size(); ++copy) {
    nets[copy]->to(how.dtype);
    buffers.push_back(buffers.front().share({{"net", nets[copy]}}));
  }
  GradientBuckets::Options options;
  options.first_bytes = 200;
  options.bytes = 600;
  options.overlap = how.copies == 1;
  GradientBuckets buckets(buffers.front(), ranks, options);
  const auto passes = [&](int step, bool listened) {
    for (ParameterBuffer& buffer : buffers) buffer.zero_gradients();
    for (int micro_batch = 0; micro_batch < 2; ++micro_batch) {
      for (int copy = 0; copy < how.copies; ++copy) {
        if (listened && how.copies == 1 && micro_batch == 1) buckets.expect_last_backward();
        const int left_out = ranks.rank() == 1 || step == 2 ? (step + micro_batch) % kLayers : -1;
        const Tensor x = input(ranks.rank(), step, 2 * copy + micro_batch, how.dtype);
        nets[static_cast<std::size_t>(copy)]->forward(x, left_out).backward();
      }
    }
  };
  for (int step = 0; step < 5; ++step) {
    passes(step, false);
    for (ParameterBuffer& buffer : buffers) buffer.collect_gradients();
    Tensor expected = buffers.front().gradient().clone();
    for (std::size_t copy = 1; copy < buffers.size(); ++copy) expected += buffers[copy].gradient();
    ranks.start_sum(expected)->wait();
    passes(step, true);
    buckets.start_rest(buffers);
    buckets.finish();
    const Tensor& summed = buffers.front().gradient();
    EXPECT_TRUE(torch::allclose(summed, expected, 1e-6, 1e-7)) << "step " << step;
    if (how.ranks == 2) {
      EXPECT_TRUE(torch::equal(summed, expected)) << "two addends have one sum";
    }
    EXPECT_GT(summed.abs().max().item<float>(), 1e-3f);
    EXPECT_TRUE(buckets.own_gradients_finite());
  }
  EXPECT_GE(buckets.buckets(), 3u);
}

TEST(GradientBuckets, SumWhatASumAfterwardsSums) {
  for (const BucketCase& how :
       {BucketCase{2, 1, torch::kFloat32}, BucketCase{3, 1, torch::kFloat32}, BucketCase{2, 1, torch::kBFloat16},
        BucketCase{2, 2, torch::kFloat32}, BucketCase{2, 2, torch::kBFloat16}}) {
    test::run_ranks_well(how.ranks, [&](Communicator& ranks) { compare_with_a_sum_afterwards(ranks, how); });
  }
}

TEST(GradientBuckets, TellWhoseGradientWasNotFinite) {
  test::run_ranks_well(2, [](Communicator& ranks) {
    const auto net = std::make_shared<NetImpl>();
    std::vector<ParameterBuffer> buffers;
    buffers.emplace_back(std::vector<nn::NamedModel>{{"net", net}});
    GradientBuckets buckets(buffers.front(), ranks, {});
    for (int step = 0; step < 3; ++step) {
      buffers.front().zero_gradients();
      buckets.expect_last_backward();
      const bool bad = step == 1 && ranks.rank() == 1;
      (net->forward(input(0, 0, 0, torch::kFloat32), -1) * (bad ? std::nan("") : 1.0)).backward();
      buckets.start_rest(buffers);
      buckets.finish();
      EXPECT_EQ(buckets.own_gradients_finite(), !bad);
      EXPECT_EQ(torch::isfinite(buffers.front().gradient()).all().item<bool>(), step != 1) << "everybody sees it";
    }
  });
}

TEST(GradientBuckets, HooksEndWithThem) {
  test::run_ranks_well(2, [](Communicator& ranks) {
    const auto net = std::make_shared<NetImpl>();
    std::vector<ParameterBuffer> buffers;
    buffers.emplace_back(std::vector<nn::NamedModel>{{"net", net}});
    {
      GradientBuckets buckets(buffers.front(), ranks, {});
      buckets.expect_last_backward();
    }
    EXPECT_NO_THROW(net->forward(input(0, 0, 0, torch::kFloat32), -1).backward());
    ranks.barrier();
  });
}

}  // namespace
}  // namespace anigen::train
