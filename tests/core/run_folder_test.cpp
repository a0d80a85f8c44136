#include "anigen/core/run_folder.h"

#include <gtest/gtest.h>

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

}  // namespace
}  // namespace anigen
