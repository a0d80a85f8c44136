#include <gtest/gtest.h>
#include <chrono>
#include <stdexcept>
#include <thread>

#include "anigen/core/error.h"
#include "anigen/nn/kernels/tiles.h"
#include "anigen/nn/profile.h"
#include "anigen/nn/torch.h"
#include "tests/parity/described_part.h"

namespace anigen::test {

namespace {

TEST(DescribedPart, ReadsStartStopAndStep) {
  const torch::Tensor volume = torch::arange(2 * 10 * 12).reshape({2, 10, 12});
  const auto expect = [&](const std::string& description, const torch::Tensor& wanted) {
    EXPECT_TRUE(torch::equal(described_part(volume, description), wanted)) << description;
  };
  expect("logits[:,:,:]", volume);
  expect("[:,1::4,::3] of the logits", volume.slice(1, 1, 10, 4).slice(2, 0, 12, 3));
  expect("[0:1,0:8:2,3:5]", volume.slice(0, 0, 1).slice(1, 0, 8, 2).slice(2, 3, 5));
  expect("int [3] rows, [:, 2:, :-2]", volume.slice(1, 2, 10).slice(2, 0, 10));
}

TEST(DescribedPart, RefusesWhatItCannotRead) {
  const torch::Tensor volume = torch::zeros({2, 3, 4});
  for (const char* description : {"all of it", "[:,:]", "[:,:,:,:]", "[:,:,1]", "[:,,:]", "[:,:,0:1:2:3]"})
    EXPECT_THROW(described_part(volume, description), std::runtime_error) << description;
}

}  // namespace

}  // namespace anigen::test

namespace anigen::nn {

namespace {

using Row = OperatorProfile::Row;

TEST(Device, IsCpuOrACudaDeviceThatIsThere) {
  EXPECT_EQ(parse_device("cpu"), torch::Device(torch::kCPU));
  for (const char* name : {"", "gpu", "cuda:", "cuda:x", "cuda:1234", "cuda:999", "CPU"})
    EXPECT_THROW(parse_device(name), InputError) << name;
}

Row row_of(const std::vector<Row>& rows, const std::string& name) {
  for (const Row& row : rows) {
    if (row.name == name) return row;
  }
  return {name, 0, 0.0};
}

TEST(OperatorProfile, CountsOperatorsAndTakesInnerOnesFromTheOuter) {
  const torch::Tensor a = torch::randn({256, 256}), b = torch::randn({256, 256}).requires_grad_();
  const OperatorProfile profile;
  const auto begun = std::chrono::steady_clock::now();
  {
    RECORD_USER_SCOPE("test: outer");
    torch::mm(a, b).sum().backward();
    {
      RECORD_USER_SCOPE("test: inner");
      std::this_thread::sleep_for(std::chrono::milliseconds(40));
    }
  }
  const double whole = std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  const std::vector<Row> rows = profile.rows();
  EXPECT_EQ(row_of(rows, "aten::mm").calls, 2);  // one in the backward pass
  EXPECT_EQ(row_of(rows, "MmBackward0").calls, 1);
  EXPECT_EQ(row_of(rows, "test: outer").calls, 1);
  EXPECT_GE(row_of(rows, "test: inner").seconds, 0.04);
  EXPECT_LE(row_of(rows, "test: outer").seconds + row_of(rows, "test: inner").seconds, whole);
  for (std::size_t i = 1; i < rows.size(); ++i) EXPECT_GE(rows[i - 1].seconds, rows[i].seconds);
  const std::vector<Row> groups = OperatorProfile::by_group(rows);
  EXPECT_EQ(row_of(groups, "test").calls, 2);
  EXPECT_EQ(row_of(groups, "matrix products").calls, 2);
  EXPECT_GT(row_of(groups, "elementwise and copies").calls, 0);
}

TEST(OperatorProfile, SeesNothingAfterItsEndAndCanBeStartedAgain) {
  const torch::Tensor a = torch::ones({2});
  {
    const OperatorProfile first;
    EXPECT_THROW(OperatorProfile(), std::logic_error);
    a.exp();
    EXPECT_EQ(row_of(first.rows(), "aten::exp").calls, 1);
  }
  a.exp();
  const OperatorProfile second;
  EXPECT_EQ(row_of(second.rows(), "aten::exp").calls, 0);
}

TEST(OperatorProfile, TablesGiveTimesPerStep) {
  // 10 + 5 + 4 = 19 ms of two steps' 40 at the peak.
  const Work products{3e9, 0.0, 0.0}, attention{0.0, 2e9, 0.0}, copies{0.0, 0.0, 4e7};
  const std::string text = profile_markdown(
      {{"aten::mm", 6, 0.03, products}, {"attention: dense", 2, 0.005, attention}, {"aten::copy_", 4, 0.005, copies}},
      2, {3e11, 4e11, 1e10});
  EXPECT_NE(text.find("| matrix products | 3.0 | 15.00 | 75.0 % | 100 |"), std::string::npos) << text;
  EXPECT_NE(text.find("| attention: dense | 1.0 | 2.50 | 12.5 % | 400 |"), std::string::npos) << text;
  EXPECT_NE(text.find("1.50 GFLOP in fp32 and 1.00 in bf16 and moves 0.02 GB"), std::string::npos) << text;
  EXPECT_NE(text.find("48 % of its 20 ms"), std::string::npos) << text;
}

TEST(OperatorProfile, CountsTheWorkOfOperators) {
  const torch::Tensor a = torch::randn({64, 32}), b = torch::randn({32, 48}), bias = torch::randn({48});
  const OperatorProfile profile;
  EXPECT_TRUE(is_profiled());
  torch::mm(a, b);
  torch::addmm(bias, a, b);
  a.exp();
  a.t();
  {
    RECORD_USER_SCOPE("test: products");
    count_operations(100.0, /*mixed=*/true);
    count_operations(7.0, /*mixed=*/false);
  }
  count_operations(1e9, false);  // in no operator
  const std::vector<Row> rows = profile.rows();
  EXPECT_EQ(row_of(rows, "aten::mm").work.fp32, 2.0 * 64 * 32 * 48);
  EXPECT_EQ(row_of(rows, "aten::addmm").work.fp32, 2.0 * 64 * 32 * 48);
  EXPECT_EQ(row_of(rows, "aten::exp").work.bytes, 2.0 * 4 * 64 * 32);
  EXPECT_EQ(row_of(rows, "aten::t").work.bytes, 0.0);
  EXPECT_EQ(row_of(rows, "test: products").work.bf16, 100.0);
  EXPECT_EQ(row_of(rows, "test: products").work.fp32, 7.0);
}

TEST(MachinePeak, IsThatOfAMachine) {
  const MachinePeak peak = measure_machine_peak();
  EXPECT_GT(peak.fp32, 1e8);
  EXPECT_GT(peak.bytes, 1e8);
  EXPECT_EQ(peak.bf16 > 0.0, kernels::has_bf16_products());
}

}  // namespace

}  // namespace anigen::nn
