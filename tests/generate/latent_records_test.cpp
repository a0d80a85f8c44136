#include <gtest/gtest.h>
#include <filesystem>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/generate/latent_records.h"
#include "tests/support/paths.h"

namespace anigen::generate {

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

namespace {

class Manifest : public testing::Test {
 protected:
  Manifest() {
    LatentManifest first(folder_.path(), "A");
    first.add("one", "voxels 1", "first commit");
    first.add("two", "voxels 2", "second commit");
  }
  bool on_disk(const std::string& encoder, const std::string& id, const std::string& inputs) const {
    return LatentManifest(folder_.path(), encoder).up_to_date(id, inputs);
  }
  test::TemporaryFolder folder_;
};

TEST_F(Manifest, KeepsWhatWasAddedHoweverARunEnds) {
  EXPECT_TRUE(on_disk("A", "one", "voxels 1"));
  EXPECT_FALSE(on_disk("A", "one", "other voxels"));
  EXPECT_FALSE(on_disk("A", "three", "voxels 3"));
  EXPECT_FALSE(on_disk("B", "one", "voxels 1"));
}

// State after a kill: the file as it is while the run goes on.
TEST_F(Manifest, PromisesNothingThatIsAboutToBeReplaced) {
  LatentManifest running(folder_.path(), "A");
  running.forget({"one"});
  EXPECT_FALSE(on_disk("A", "one", "voxels 1"));
  EXPECT_TRUE(on_disk("A", "two", "voxels 2"));
  running.add("one", "voxels 1, again", "third commit");
  EXPECT_FALSE(on_disk("A", "one", "voxels 1"));
}

TEST_F(Manifest, OfAnotherEncoderForgetsTheFirst) {
  LatentManifest running(folder_.path(), "B");
  EXPECT_TRUE(on_disk("A", "one", "voxels 1")) << "nothing is replaced yet";
  running.forget({"one"});
  EXPECT_FALSE(on_disk("A", "one", "voxels 1"));
  EXPECT_FALSE(on_disk("A", "two", "voxels 2"));
}

TEST_F(Manifest, SaysWhichProgramEncodedAnAsset) {
  const LatentManifest manifest(folder_.path(), "A");
  EXPECT_EQ(manifest.commit_of("one"), "first commit");
  EXPECT_EQ(manifest.commit_of("two"), "second commit");
  // A file of a program that recorded no commit still says what was encoded.
  write_file_atomically(folder_ / "encoded.json", R"({"encoder": "A", "assets": {"one": "voxels 1"}})");
  EXPECT_TRUE(on_disk("A", "one", "voxels 1"));
  EXPECT_EQ(LatentManifest(folder_.path(), "A").commit_of("one"), "");
}

TEST_F(Manifest, ThatIsDamagedCountsAsEmpty) {
  write_file_atomically(folder_ / "encoded.json", R"({"encoder": "A", "assets": {"one": 3}})");
  EXPECT_FALSE(on_disk("A", "one", "voxels 1"));
}

}  // namespace

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

}  // namespace anigen::generate
