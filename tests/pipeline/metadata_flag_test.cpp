#include "anigen/pipeline/metadata_flag.h"

#include <gtest/gtest.h>

#include <thread>
#include <vector>

#include "anigen/core/atomic_file.h"
#include "anigen/core/csv.h"
#include "anigen/core/error.h"
#include "tests/support/paths.h"

namespace anigen::pipeline {
namespace {

class MetadataFlag : public testing::Test {
 protected:
  MetadataFlag() { write_file_atomically(table(), "sha256,note\na,\"x, y\"\nb,\n"); }
  std::filesystem::path table() const { return folder_ / "metadata.csv"; }
  test::TemporaryFolder folder_;
};

TEST_F(MetadataFlag, ChangesItsColumnAlone) {
  set_metadata_flag(folder_.path(), "done", {"b", "not there"});
  EXPECT_EQ(read_file(table()), "sha256,note,done\na,\"x, y\",False\nb,,True\n");
  set_metadata_flag(folder_.path(), "done", {"a"});
  EXPECT_EQ(read_file(table()), "sha256,note,done\na,\"x, y\",True\nb,,False\n");
}

TEST_F(MetadataFlag, WritersAtTheSameTimeLoseNothing) {
  constexpr int kWriters = 8;
  std::vector<std::thread> writers;
  for (int i = 0; i < kWriters; ++i) {
    writers.emplace_back([this, i] { set_metadata_flag(folder_.path(), "flag" + std::to_string(i), {"a"}); });
  }
  for (std::thread& writer : writers) writer.join();
  const CsvTable result = read_csv(table());
  ASSERT_EQ(result.columns.size(), 2u + kWriters);
  for (int i = 0; i < kWriters; ++i) EXPECT_EQ(result.cell(0, "flag" + std::to_string(i)), "True");
}

TEST_F(MetadataFlag, KeepsOffWhilePrepareWritesTheTables) {
  {
    const auto prepare = FileLock::try_lock(dataset_lock_file(folder_.path()), FileLock::Kind::kExclusive);
    EXPECT_THROW(set_metadata_flag(folder_.path(), "done", {"a"}), InputError);
  }
  EXPECT_NO_THROW(set_metadata_flag(folder_.path(), "done", {"a"}));
}

TEST_F(MetadataFlag, LeavesNothingWhereThereIsNoDataset) {
  EXPECT_THROW(set_metadata_flag(folder_ / "absent", "done", {}), InputError);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "absent"));
}

}  // namespace
}  // namespace anigen::pipeline
