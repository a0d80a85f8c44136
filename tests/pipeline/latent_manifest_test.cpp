#include "anigen/pipeline/latent_manifest.h"

#include <gtest/gtest.h>

#include "anigen/core/atomic_file.h"
#include "tests/support/paths.h"

namespace anigen::pipeline {
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

// What a kill leaves: the file as it is while the run goes on.
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
}  // namespace anigen::pipeline
