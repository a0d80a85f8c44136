#include "anigen/core/run_folder.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "tests/support/paths.h"

namespace anigen {
namespace {

TEST(RunFolder, IsFoundAroundItsFiles) {
  const test::TemporaryFolder folder;
  write_file_atomically(folder / "run/config.json", "{}");
  write_file_atomically(folder / "run/ckpts/model_step1.safetensors", "");
  write_file_atomically(folder / "other/model.safetensors", "");
  for (const char* file : {"run/ckpts/model_step1.safetensors", "run/model.safetensors"}) {
    const auto found = RunFolder::around(folder / file);
    ASSERT_TRUE(found) << file;
    EXPECT_EQ(found->root.filename(), "run") << file;
  }
  EXPECT_FALSE(RunFolder::around(folder / "run/samples/model.safetensors"));
  EXPECT_FALSE(RunFolder::around(folder / "other/model.safetensors"));
}

TEST(RunFolder, WithoutCheckpointsFilesLieInTheFolderItself) {
  const test::TemporaryFolder folder;
  EXPECT_EQ(RunFolder{folder.path()}.checkpoint_files(), folder.path());
  write_file_atomically(folder / "ckpts/state_step1.safetensors", "");
  EXPECT_EQ(RunFolder{folder.path()}.checkpoint_files(), folder / "ckpts");
}

TEST(StreamFolder, KeepsItsIndexAndTheNewestGenerationInUse) {
  const test::TemporaryFolder folder;
  const StreamFolder stream{folder.path()};
  EXPECT_FALSE(stream.exists());
  EXPECT_EQ(stream.used_generation(), 0u);
  StreamIndex index;
  index.generation = 3;
  index.shards = {4, 2, 3};
  index.before = {1, 2, 3};
  index.settings = {{"seed", 7}};
  stream.write_index(index);
  EXPECT_TRUE(stream.exists());
  EXPECT_EQ(Json(stream.read_index()), Json(index));
  stream.mark_used(3);
  stream.mark_used(2);
  EXPECT_EQ(stream.used_generation(), 3u);
  EXPECT_EQ(stream.shard(12).filename(), "shard-000012");
  write_file_atomically(stream.index(), "{\"generation\": 3}");
  EXPECT_THROW(stream.read_index(), InputError);
}

}  // namespace
}  // namespace anigen
