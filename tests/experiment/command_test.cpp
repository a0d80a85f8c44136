#include "anigen/experiment/command.h"

#include <gtest/gtest.h>

#include "anigen/experiment/run_jobs.h"
#include "tests/support/paths.h"

namespace anigen::experiment {
namespace {

JobRecord done(double seconds, double expected) {
  JobRecord record;
  record.state = JobRecord::State::kDone;
  record.step = "fit";
  record.seconds = seconds;
  record.expected_seconds = expected;
  return record;
}

Job job(double minutes) {
  Job job;
  job.step = "fit";
  job.minutes = minutes;
  return job;
}

TEST(Estimates, AreTheAuthorsCorrectedByWhatEarlierJobsTook) {
  const test::TemporaryFolder folder;
  EXPECT_EQ(Estimates(folder.path()).seconds(job(2)), 120);
  write_record(folder.path(), "fit-0000000001", done(240, 120));
  EXPECT_EQ(Estimates(folder.path()).seconds(job(2)), 240);
  EXPECT_EQ(Estimates(folder.path()).seconds(job(30)), 3600) << "a machine half as fast as the author's";
  EXPECT_EQ(Estimates(folder.path()).seconds(job(0)), 240) << "nothing stated: as the one before";
  write_record(folder.path(), "fit-0000000002", done(60, 0));  // of a file that states nothing
  EXPECT_EQ(Estimates(folder.path()).seconds(job(2)), 240);
  EXPECT_EQ(Estimates(folder.path()).seconds(job(0)), 150);
}

}  // namespace
}  // namespace anigen::experiment
