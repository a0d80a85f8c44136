#include "tests/parity/described_part.h"

#include <gtest/gtest.h>

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
  for (const char* description : {"all of it", "[:,:]", "[:,:,:,:]", "[:,:,1]", "[:,,:]", "[:,:,0:1:2:3]"}) {
    EXPECT_THROW(described_part(volume, description), std::runtime_error) << description;
  }
}

}  // namespace
}  // namespace anigen::test
