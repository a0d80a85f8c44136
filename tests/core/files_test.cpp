#include "anigen/core/files.h"

#include <gtest/gtest.h>

#include <fstream>
#include <new>
#include <stdexcept>

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

TEST(MakeFolders, MakesThoseAboveAndRefusesFiles) {
  const test::TemporaryFolder folder;
  make_folders(folder / "a/b/c/");
  EXPECT_TRUE(std::filesystem::is_directory(folder / "a/b/c"));
  EXPECT_NO_THROW(make_folders(folder / "a/b/c"));
  EXPECT_NO_THROW(make_folders(""));
  std::filesystem::create_directory_symlink(folder / "a", folder / "link");
  make_folders(folder / "link/d");
  EXPECT_TRUE(std::filesystem::is_directory(folder / "a/d"));
  write_file_atomically(folder / "file", "x");
  EXPECT_THROW(make_folders(folder / "file"), Error);
  EXPECT_THROW(make_folders(folder / "file/e"), Error);
}

TEST(RemoveLastingly, RemovesFilesAndFoldersAndNothing) {
  const test::TemporaryFolder folder;
  write_file_atomically(folder / "a/b/file", "x");
  remove_lastingly(folder / "a/b/file");
  EXPECT_FALSE(std::filesystem::exists(folder / "a/b/file"));
  EXPECT_TRUE(std::filesystem::exists(folder / "a/b"));
  remove_lastingly(folder / "a");
  EXPECT_FALSE(std::filesystem::exists(folder / "a"));
  EXPECT_NO_THROW(remove_lastingly(folder / "a"));
  EXPECT_NO_THROW(remove_lastingly(folder / "missing/file"));
  EXPECT_THROW(remove_lastingly("/proc/version"), WriteError);
}

TEST(MoveIntoFolder, KeepsTheNameAndMakesTheFolder) {
  const test::TemporaryFolder folder;
  write_file_atomically(folder / "file", "x");
  move_into_folder(folder / "file", folder / "a/b");
  EXPECT_EQ(read_file(folder / "a/b/file"), "x");
  EXPECT_FALSE(std::filesystem::exists(folder / "file"));
  try {
    move_into_folder(folder / "missing", folder / "a");
    FAIL() << "moved a file that is not there";
  } catch (const WriteError& error) {
    EXPECT_NE(std::string(error.what()).find("missing"), std::string::npos);
  }
}

TEST(WriteFile, FailureIsAnErrorThatNamesThePath) {
  try {
    write_file_atomically("/proc/anigen/file", "x");
    FAIL() << "wrote into /proc";
  } catch (const WriteError& error) {
    EXPECT_NE(std::string(error.what()).find("/proc"), std::string::npos);
  }
}

TEST(WriteFile, ANameThatNoFileCanHaveIsNoFaultOfTheDisk) {
  const test::TemporaryFolder folder;
  try {
    write_file_atomically(folder / std::string(300, 'x'), "x");
    FAIL() << "wrote a file with a name of 300 letters";
  } catch (const WriteError& error) {
    FAIL() << error.what();
  } catch (const Error& error) {
    EXPECT_NE(std::string(error.what()).find("too long"), std::string::npos) << error.what();
  }
}

class RefuseToOverwrite : public testing::Test {
 protected:
  RefuseToOverwrite() {
    write_file_atomically(folder_ / "in/mesh.glb", "mesh");
    write_file_atomically(folder_ / "in/other.glb", "other");
  }
  /// @return the message, or "" when nothing is wrong
  std::string problem(const std::vector<fs::path>& outputs, const std::vector<fs::path>& inputs) const {
    try {
      refuse_to_overwrite(outputs, [&] { return inputs; });
    } catch (const InputError& error) {
      return error.what();
    }
    return "";
  }
  test::TemporaryFolder folder_;
};

TEST_F(RefuseToOverwrite, TheSameFileHoweverItIsSpelled) {
  const fs::path mesh = folder_ / "in/mesh.glb";
  fs::create_symlink(mesh, folder_ / "soft.glb");
  fs::create_hard_link(mesh, folder_ / "hard.glb");
  fs::create_directory_symlink(folder_ / "in", folder_ / "linked");
  for (const fs::path& output : {mesh, folder_ / "in/./mesh.glb", folder_ / "in/../in/mesh.glb", fs::relative(mesh),
                                 folder_ / "soft.glb", folder_ / "hard.glb", folder_ / "linked/mesh.glb"}) {
    EXPECT_NE(problem({folder_ / "new.glb", output}, {folder_ / "in/other.glb", mesh}), "") << output;
    EXPECT_NE(problem({mesh}, {output}), "") << output << ", as an input";
  }
  const std::string told = problem({folder_ / "soft.glb"}, {mesh});
  EXPECT_NE(told.find((folder_ / "soft.glb").string()), std::string::npos) << told;
  EXPECT_NE(told.find(mesh.string()), std::string::npos) << told;
}

TEST_F(RefuseToOverwrite, NothingElse) {
  EXPECT_EQ(problem({folder_ / "in/new.glb", ""}, {folder_ / "in/mesh.glb", ""}), "");
  EXPECT_EQ(problem({folder_ / "in/other.glb"}, {folder_ / "in/mesh.glb", folder_ / "missing"}), "") << "equal size";
  bool asked = false;
  refuse_to_overwrite({folder_ / "in/new.glb"}, [&] {
    asked = true;
    return std::vector<fs::path>();
  });
  EXPECT_FALSE(asked) << "listing inputs may take long";
}

/// Text that a batch records for an item that throws this.
template <typename Exception>
std::string failure_by(const Exception& exception) {
  try {
    throw exception;
  } catch (...) {
    return failure_of_item();
  }
}

TEST(FailureOfItem, IsOneLineOfWhateverAnItemThrows) {
  EXPECT_EQ(failure_by(InputError("a.glb", "byte 3", "is cut off")), "a.glb: byte 3: is cut off");
  EXPECT_EQ(failure_by(Error("no surface")), "no surface");
  EXPECT_EQ(failure_by(std::bad_alloc()), "out of memory");
  EXPECT_EQ(failure_by(std::runtime_error("shapes differ:\n3 and 4\nException raised from f at x.cpp:1\nframe #0: g")),
            "shapes differ: 3 and 4");
  EXPECT_EQ(failure_by(std::runtime_error("OpenCV: assertion failed\n")), "OpenCV: assertion failed");
  EXPECT_EQ(failure_by(std::runtime_error("\n")), "failed without a message");
}

TEST(FailureOfItem, LeavesWhatConcernsTheWholeRunToTheRun) {
  EXPECT_THROW(failure_by(Interrupted("stopped")), Interrupted);
  EXPECT_THROW(failure_by(WriteError("disk full")), WriteError);
  EXPECT_THROW(failure_by(3), int);
}

}  // namespace
}  // namespace anigen
