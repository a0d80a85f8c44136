#include "anigen/pipeline/latent_folder.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "tests/support/paths.h"

namespace anigen::pipeline {
namespace {

namespace fs = std::filesystem;

TEST(LatentFolder, IsCalledAsTheRunWasWritten) {
  EXPECT_EQ(LatentFolder("data", "", "runs/ss_dae").name(), "ss_dae");
  EXPECT_EQ(LatentFolder("data", "", "runs/ss_dae/").name(), "ss_dae");
  EXPECT_EQ(LatentFolder("data", "", "runs/other/../ss_dae/.").name(), "ss_dae");
  EXPECT_EQ(LatentFolder("data", "given", "runs/ss_dae").file("a"), fs::path("data/ss_latents/given/a.npz"));
  const test::TemporaryFolder folder;
  fs::create_directories(folder / "run-2024");
  fs::create_directory_symlink(folder / "run-2024", folder / "best");
  EXPECT_EQ(LatentFolder("data", "", folder / "best").name(), "best");
  EXPECT_THROW(LatentFolder("data", "", "/"), InputError) << "a root has no name";
}

TEST(LatentStatistics, NameChannelsThatDoNotVary) {
  LatentStatistics statistics;
  statistics.add(moments_of({0, 0, 7.3f, 7.3f, 7.3f, 7.31f}, 3, "one"), "one");
  statistics.add(moments_of({0, 0, 7.3f, 7.3f, 7.3f, 7.31f}, 3, "two"), "two");
  EXPECT_EQ(statistics.constant_channels(), (std::vector<std::size_t>{0, 1}));
}

}  // namespace
}  // namespace anigen::pipeline
