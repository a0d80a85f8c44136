#include "tests/device/counting_device.h"

#include <gtest/gtest.h>

namespace anigen::test {
namespace {

using torch::Tensor;

class CountingDevice : public ::testing::Test {
 protected:
  void SetUp() override { forget_requests(); }
  const torch::Device device_ = counting_device();
};

TEST_F(CountingDevice, ComputesWhatTheCpuComputes) {
  torch::manual_seed(3);
  const Tensor x = torch::randn({5, 7}), w = torch::randn({4, 7}), rows = torch::tensor({3, 0, 4});
  const auto network = [](const Tensor& input, const Tensor& weight, const Tensor& chosen) {
    const Tensor y = torch::gelu(torch::nn::functional::linear(input, weight)).index_select(0, chosen);
    return torch::cat({y, y.transpose(0, 1).reshape({-1, 4}).slice(0, 0, 1)}, 0).square().sum();
  };
  Tensor weight = w.clone().requires_grad_(), there = w.to(device_).requires_grad_();
  const Tensor loss = network(x, weight, rows), far = network(x.to(device_), there, rows.to(device_));
  loss.backward();
  far.backward();
  EXPECT_EQ(far.device(), device_);
  EXPECT_EQ(far.item<double>(), loss.item<double>());
  EXPECT_TRUE(torch::equal(there.grad().to(torch::kCPU), weight.grad()));
}

TEST_F(CountingDevice, ChangesInPlaceAndViewsReachTheirTensor) {
  Tensor x = torch::zeros({4, 3}, device_);
  x.select(0, 1).add_(2.0);
  x.narrow(1, 0, 1).fill_(5.0);
  Tensor grown = torch::empty({0}, device_);
  torch::add_out(grown, x, x);
  EXPECT_TRUE(torch::equal(grown.to(torch::kCPU),
                           2.0 * torch::tensor({{5.F, 0.F, 0.F}, {5.F, 2.F, 2.F}, {5.F, 0.F, 0.F}, {5.F, 0.F, 0.F}})));
}

TEST_F(CountingDevice, CountsTheTimesThatTheHostWaits) {
  const Tensor host = torch::tensor({1.0F, 0.0F, 2.0F}), x = nn::to_device(host, device_);
  Tensor y = torch::relu(x - 1.0).sum();
  EXPECT_EQ(device_requests().all_waits(), 0) << waits_text(device_requests());
  EXPECT_GE(device_requests().operators, 3);
  y.item<float>();
  x.nonzero();
  x.index({x > 0.0});
  x.to(torch::kCPU);
  host.to(device_);
  const DeviceRequests found = device_requests();
  EXPECT_EQ(found.all_waits(), 5) << waits_text(found);
  EXPECT_EQ(found.waits.at("aten::_local_scalar_dense"), 1);
  EXPECT_EQ(found.waits.at("aten::nonzero"), 2) << "a mask is turned into a list of places first";
  EXPECT_EQ(found.waits.at("copy to the host"), 1);
  EXPECT_EQ(found.waits.at("copy of pageable memory"), 1);
}

TEST_F(CountingDevice, ItsMemoryIsNoneOfTheHost) {
  const Tensor x = torch::ones({4}, device_);
  EXPECT_DEATH(static_cast<void>(*static_cast<volatile float*>(x.data_ptr())), "");
}

}  // namespace
}  // namespace anigen::test
