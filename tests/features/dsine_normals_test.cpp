#include "anigen/features/dsine_normals.h"

#include <gtest/gtest.h>

#include <memory>
#include <string>

#include "anigen/core/error.h"
#include "anigen/models/state_dict.h"

namespace anigen::features {
namespace {

// Every convolution is a mean, and its bias.
models::Dsine averaging_network() {
  models::Dsine network;
  for (const models::StateEntry& entry : models::state_entries(*network)) {
    const bool kernel = entry.tensor.dim() == 4;
    entry.tensor.fill_(kernel ? static_cast<double>(entry.tensor.size(0)) / static_cast<double>(entry.tensor.numel())
                              : 0.1);
  }
  return network;
}

TEST(DsineNormals, AreOnePerPixel) {
  const std::unique_ptr<NormalEstimator> estimator = std::make_unique<DsineNormals>(averaging_network());
  torch::manual_seed(1);
  const torch::Tensor rgb = torch::rand({1, 3, 40, 71}), normals = estimator->normals(rgb);
  ASSERT_EQ(normals.sizes(), rgb.sizes());
  EXPECT_EQ(normals.scalar_type(), torch::kFloat32);
  EXPECT_FALSE(normals.requires_grad());
  EXPECT_LT((normals.norm(2, {1}) - 1.0).abs().max().item<float>(), 1e-5f);
  EXPECT_TRUE(torch::equal(estimator->normals(rgb), normals)) << "a second call";
}

TEST(DsineNormals, RefusesPicturesThatWouldNotFit) {
  DsineNormals estimator{models::Dsine()};
  const auto refusal = [&](std::int64_t height, std::int64_t width) -> std::string {
    try {
      estimator.normals(torch::zeros({1, 3, 1, 1}).expand({1, 3, height, width}));  // takes no memory
    } catch (const InputError& error) {
      return error.what();
    }
    return "accepted";
  };
  const std::string message = refusal(3000, 20000);
  for (const std::string word : {"20000 x 3000", "16777216"})
    EXPECT_NE(message.find(word), std::string::npos) << word << " in: " << message;
  EXPECT_NE(refusal(4097, 4096), "accepted");
  EXPECT_NE(refusal(1, 600000), "accepted") << "32 rows of padding";
}

}  // namespace
}  // namespace anigen::features
