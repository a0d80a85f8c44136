#include "anigen/generate/asset_generator.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <vector>

#include "anigen/core/files.h"
#include "anigen/generate/finishing.h"
#include "tests/support/paths.h"

namespace anigen::generate {
namespace {

// docs/reference/flows.md, 7.2: what the published program draws for seed 42.
TEST(GenerationNoise, IsThePublishedOne) {
  const at::Generator generator = noise_generator(42);
  const std::vector<std::vector<std::int64_t>> sizes{{1, 8, 16, 16, 16}, {1, 4, 16, 16, 16}, {1001, 16}, {503, 4}};
  const std::vector<std::vector<float>> first{{1.9269153F, 1.4872841F, 0.9007172F, -2.1055210F},
                                              {-0.7837821F, -0.3568874F, -1.3867873F, 1.4456867F},
                                              {1.2653142F, 0.1725847F, -0.1983433F, 1.1283627F},
                                              {0.0758839F, -0.0102992F, 0.4272086F, 1.1499642F}};
  std::vector<torch::Tensor> draws;
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    draws.push_back(torch::randn(sizes[i], generator).flatten());
    EXPECT_TRUE(torch::allclose(draws[i].slice(0, 0, 4), torch::tensor(first[i]), 0.0, 1e-6))
        << draws[i].slice(0, 0, 4);
  }
  EXPECT_NEAR(draws[0][-1].item<float>(), -0.2654118F, 1e-6F);
  EXPECT_TRUE(torch::allclose(draws[3].slice(0, -2), torch::tensor({0.7880555F, 0.0347525F}), 0.0, 1e-6));
}

TEST(GroupingOfFlow, ItsOwnFitGoesBeforeThatOfItsAutoEncoder) {
  const test::TemporaryFolder folder;
  const std::filesystem::path flow = folder / "flow", autoencoder = folder / "autoencoder";
  for (const std::filesystem::path& run : {flow, autoencoder}) std::filesystem::create_directories(run);
  write_file_atomically(autoencoder / "grouping.json", R"({"bandwidth": 0.01, "least_votes": 14})");
  skeleton_field::MeanShiftOptions asked;
  asked.bandwidth = 0.0F;
  asked.min_cluster_size = 0;
  EXPECT_EQ(grouping_of_flow(asked, flow, autoencoder).min_cluster_size, 14);
  write_file_atomically(flow / "grouping.json", R"({"bandwidth": 0.04, "least_votes": 9})");
  EXPECT_FLOAT_EQ(grouping_of_flow(asked, flow, autoencoder).bandwidth, 0.04F);
  EXPECT_EQ(grouping_of_flow(asked, flow, autoencoder).min_cluster_size, 9);
  asked.min_cluster_size = 3;
  EXPECT_EQ(grouping_of_flow(asked, flow, autoencoder).min_cluster_size, 3) << "what is asked for wins";
  EXPECT_FALSE(finishing_of_flow({}, flow).smoothing_iterations) << "nothing said: as published";
  write_file_atomically(flow / "grouping.json", R"({"bandwidth": 0.04, "least_votes": 9, "smoothing": 2})");
  EXPECT_EQ(finishing_of_flow({}, flow).smoothing_iterations, 2);
  FinishingOptions finishing;
  finishing.smoothing_iterations = 7;
  EXPECT_EQ(finishing_of_flow(finishing, flow).smoothing_iterations, 7) << "what is asked for wins";
}

}  // namespace
}  // namespace anigen::generate
