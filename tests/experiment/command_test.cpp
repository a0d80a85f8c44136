#include "anigen/experiment/command.h"

#include <gtest/gtest.h>

#include "anigen/experiment/run_jobs.h"
#include "tests/experiment/experiment_folder.h"
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

class ExperimentCommands : public ExperimentFolder {};

TEST_F(ExperimentCommands, AnOptionThatIsRefusedShowsBeforeTheFirstJobRuns) {
  write("experiment.json", kTwoVariants);
  write("refuse", "--pred");
  ExperimentCommand command;
  command.file = folder_ / "experiment.json";
  command.place = place_;
  for (const bool dry_run : {true, false}) {
    command.dry_run = dry_run;
    const std::string said = error_of([&] { run_experiment_command(command, false); });
    EXPECT_NE(said.find("experiment.json: /steps/score: for plain, seed 0: anigen-eval says error: --pred: no such"),
              std::string::npos)
        << said;
    EXPECT_NE(said.find("--pred ours="), std::string::npos) << "the command itself: " << said;
  }
  EXPECT_EQ(calls("anigen-prepare"), 0U);
  command.what = ExperimentCommand::What::kStatus;
  EXPECT_EQ(error_of([&] { run_experiment_command(command, false); }), "no error") << "a status asks no program";

  write("experiment.json",
        R"({"title": "One", "steps": {"score": {"program": "anigen-eval", "args": {"--pred": "x"}}}})");
  command.what = ExperimentCommand::What::kRun;
  EXPECT_NE(
      error_of([&] { run_experiment_command(command, false); }).find("/steps/score: anigen-eval says error: --pred"),
      std::string::npos)
      << "one run has no name";
  write("experiment.json", kTwoVariants);

  std::filesystem::remove(folder_ / "refuse");
  run_experiment_command(command, false);
  EXPECT_EQ(calls("anigen-eval"), 4U);
}

}  // namespace
}  // namespace anigen::experiment
