#include "anigen/core/file_lock.h"

#include <gtest/gtest.h>

#include "anigen/core/error.h"
#include "tests/support/paths.h"

namespace anigen {
namespace {

using Kind = FileLock::Kind;

TEST(FileLock, SharedOnesGoTogetherAnExclusiveOneStandsAlone) {
  const test::TemporaryFolder folder;
  const auto file = dataset_lock_file(folder / "data");
  {
    const std::optional<FileLock> first = FileLock::try_lock(file, Kind::kShared);
    ASSERT_TRUE(first) << "makes the folder, too";
    EXPECT_TRUE(FileLock::try_lock(file, Kind::kShared));
    EXPECT_FALSE(FileLock::try_lock(file, Kind::kExclusive));
  }
  std::optional<FileLock> alone = FileLock::try_lock(file, Kind::kExclusive);
  ASSERT_TRUE(alone);
  const FileLock moved = std::move(*alone);
  alone.reset();
  EXPECT_FALSE(FileLock::try_lock(file, Kind::kShared)) << "the lock goes with the object";
}

TEST(FileLock, SaysWhatCannotBeOpened) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(FileLock::try_lock(folder.path(), Kind::kShared), Error) << "a folder";
}

}  // namespace
}  // namespace anigen
