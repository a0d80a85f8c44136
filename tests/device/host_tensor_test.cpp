#include "anigen/nn/host_tensor.h"

#include <gtest/gtest.h>

#include "tests/device/counting_device.h"

namespace anigen::test {
namespace {

using torch::Tensor;

TEST(HostTensor, GoesToADeviceOnce) {
  const torch::Device device = counting_device();
  const Tensor rows = torch::tensor({3, 1, 2});
  const nn::HostTensor list(rows), copy = list;
  forget_requests();
  const Tensor there = list.on(device);
  EXPECT_TRUE(copy.on(device).is_same(there)) << "copies share it";
  EXPECT_EQ(device_requests().uploads, 1);
  EXPECT_EQ(device_requests().all_waits(), 0) << waits_text(device_requests());
  EXPECT_TRUE(torch::equal(there.to(torch::kCPU), rows));
  EXPECT_TRUE(list.on(torch::kCPU).is_same(rows));
  EXPECT_TRUE(list.host().is_same(rows));
  EXPECT_FALSE(nn::HostTensor().defined());
}

}  // namespace
}  // namespace anigen::test
