#include "anigen/pipeline/latent_outcomes.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "anigen/core/atomic_file.h"
#include "tests/support/paths.h"

namespace anigen::pipeline {
namespace {

TEST(LatentOutcomes, GoFromOneProcessToTheOthers) {
  const test::TemporaryFolder folder;
  const LatentOutcomes first(folder.path(), "latent_x"), second(folder.path(), "latent_x");
  first.begin("A", {"kept"});
  std::set<std::string> kept;
  EXPECT_TRUE(second.join("A", kept));
  EXPECT_EQ(kept, std::set<std::string>{"kept"});
  EXPECT_FALSE(second.join("B", kept));
  EXPECT_FALSE(second.read("one"));
  LatentOutcome outcome;
  outcome.inputs = "voxels";
  outcome.shape = moments_of({0.1f, 0.7f, 1e-7f, 3.0f}, 2, "one");
  first.write("one", outcome);
  first.write("two", {"", "is broken", {}, {}});
  ASSERT_TRUE(second.read("one"));
  EXPECT_EQ(second.read("one")->shape.mean_square, outcome.shape.mean_square) << "bit for bit";
  EXPECT_EQ(second.read("two")->failure, "is broken");
  EXPECT_FALSE(second.concluded());
  first.set_concluded();
  EXPECT_TRUE(second.concluded());
}

// Two builds of the program do not share a run: their latents may differ.
TEST(LatentOutcomes, AreNotSharedWithAnotherCommit) {
  const test::TemporaryFolder folder;
  const LatentOutcomes outcomes(folder.path(), "latent_x");
  outcomes.begin("A", {});
  std::set<std::string> kept;
  EXPECT_TRUE(outcomes.join("A", kept));
  const auto file = folder / "run" / "encode-latent_x" / "run.json";
  Json run = read_json(file);
  run["commit"] = "0123456789";
  write_file_atomically(file, run.dump());
  EXPECT_FALSE(outcomes.join("A", kept));
}

TEST(LatentOutcomes, TellTheNextRunWhatWasEncodedByItsEncoder) {
  const test::TemporaryFolder folder;
  const LatentOutcomes outcomes(folder.path(), "latent_x");
  EXPECT_TRUE(outcomes.encoded_by("A").empty());
  outcomes.begin("A", {});
  outcomes.write("one", {"voxels", "", {}, {}, "a commit"});
  outcomes.write("kept", {"", "", {}, {}});
  outcomes.write("two", {"voxels", "is broken", {}, {}});
  write_file_atomically(folder / "run" / "encode-latent_x" / "assets" / "three.json", "{");
  const std::map<std::string, LatentOutcome> encoded = outcomes.encoded_by("A");
  ASSERT_EQ(encoded.size(), 1u);
  EXPECT_EQ(encoded.at("one").inputs, "voxels");
  EXPECT_EQ(encoded.at("one").commit, "a commit");
  EXPECT_TRUE(outcomes.encoded_by("B").empty());
  outcomes.begin("A", {});
  EXPECT_TRUE(outcomes.encoded_by("A").empty());
}

}  // namespace
}  // namespace anigen::pipeline
