#include "anigen/core/atomic_file.h"

#include <gtest/gtest.h>

#include <fstream>

#include "anigen/core/error.h"
#include "tests/support/paths.h"

namespace anigen {
namespace {

namespace fs = std::filesystem;

std::size_t files_in(const fs::path& folder) {
  return static_cast<std::size_t>(std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
}

TEST(AtomicFile, ReplacesContentAndLeavesNothingElse) {
  const test::TemporaryFolder folder;
  const fs::path path = folder / "deep/er/file.bin";
  write_file_atomically(path, "first");
  write_file_atomically(path, std::string("se\0ond", 6));
  EXPECT_EQ(read_file(path), std::string("se\0ond", 6));
  EXPECT_EQ(files_in(path.parent_path()), 1u);
}

TEST(AtomicFile, KeepsTheOldFileWhenNotCommitted) {
  const test::TemporaryFolder folder;
  const fs::path path = folder / "file.png";
  write_file_atomically(path, "old");
  {
    const AtomicFile file(path);
    EXPECT_EQ(file.temporary().extension(), ".png");
    std::ofstream(file.temporary()) << "half";
  }
  EXPECT_EQ(read_file(path), "old");
  EXPECT_EQ(files_in(folder.path()), 1u);
}

TEST(ReadFile, RefusesWhatIsNotThereNotAFileOrTooLarge) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(read_file(folder / "missing"), InputError);
  EXPECT_THROW(read_file(folder.path()), InputError);
  write_file_atomically(folder / "ten", "0123456789");
  EXPECT_THROW(read_file(folder / "ten", 9), InputError);
  EXPECT_EQ(read_file(folder / "ten", 10).size(), 10u);
}

TEST(WriteFile, FailureIsAnErrorThatNamesThePath) {
  try {
    write_file_atomically("/proc/anigen/file", "x");
    FAIL() << "wrote into /proc";
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("/proc"), std::string::npos);
  }
}

}  // namespace
}  // namespace anigen
