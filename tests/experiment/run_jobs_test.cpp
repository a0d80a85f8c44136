#include "anigen/experiment/run_jobs.h"

#include <chrono>
#include <csignal>
#include <thread>

#include "anigen/core/log.h"
#include "anigen/core/process.h"
#include "tests/experiment/experiment_folder.h"

namespace anigen::experiment {
namespace {

namespace fs = std::filesystem;

class RunJobs : public ExperimentFolder {
 protected:
  RunJobs() { log::setup("off"); }
  RunOutcome run(const Plan& p, const RunOptions& options = {}) { return run_jobs(place_.out, p, options); }
  JobRecord record(const Job& job) { return read_record(place_.out, job.id).value(); }
};

TEST_F(RunJobs, EveryJobRunsOnceAndIsKeptAfterwards) {
  const Plan p = plan(kTwoVariants);
  RunOutcome outcome = run(p, {2});
  EXPECT_EQ(outcome.done, 9u);
  EXPECT_EQ(outcome.failed + outcome.skipped + outcome.kept, 0u);
  EXPECT_EQ(calls("anigen-prepare"), 1u);
  EXPECT_EQ(calls("anigen-train"), 4u);
  const JobRecord data = record(job_of(p, 0, "data"));
  EXPECT_EQ(data.state, JobRecord::State::kDone);
  EXPECT_GT(data.peak_bytes, 0u);
  EXPECT_GT(data.disk_bytes, 0u);
  outcome = run(p);
  EXPECT_EQ(outcome.kept, 9u);
  EXPECT_EQ(calls("anigen-train"), 4u);
}

TEST_F(RunJobs, AFailureStopsWhatNeedsItAndIsTriedAgain) {
  write("fail", "anigen-train");
  const Plan p = plan(kTwoVariants);
  RunOutcome outcome = run(p);
  EXPECT_EQ(outcome.done, 1u);
  EXPECT_EQ(outcome.failed, 4u);
  EXPECT_EQ(outcome.skipped, 4u);
  EXPECT_EQ(record(job_of(p, 0, "fit")).status, 3);
  fs::remove(folder_ / "fail");
  outcome = run(p);
  EXPECT_EQ(outcome.kept, 1u);
  EXPECT_EQ(outcome.done, 8u);
  EXPECT_EQ(record(job_of(p, 0, "fit")).attempts, 2);
}

TEST_F(RunJobs, ResultsThatWereRemovedAreMadeAgain) {
  const Plan p = plan(kTwoVariants);
  run(p);
  fs::remove_all(job_of(p, 0, "score").folder);
  EXPECT_EQ(run(p).done, 1u);
}

TEST_F(RunJobs, WhatWasWrittenIntoAFolderIsMadeAgainWithIt) {
  const Plan p = plan(R"({"title": "x", "steps": {"data": {"program": "anigen-prepare"},
    "latents": {"program": "anigen-encode", "writes_into": "data", "args": {"--dataset": "{data}"}},
    "fit": {"program": "anigen-train", "config": "train.json", "after": ["latents"], "args": {"--d": "{data}"}}}})");
  EXPECT_EQ(run(p).done, 3u);
  fs::remove_all(job_of(p, 0, "data").folder);
  EXPECT_EQ(run(p).done, 2u) << "the training is still there";
  EXPECT_EQ(calls("anigen-encode"), 2u);
}

TEST_F(RunJobs, TheSameWhenTheFolderIsMadeAgainAlone) {
  const Plan p = plan(R"({"title": "x", "steps": {"data": {"program": "anigen-prepare"},
    "latents": {"program": "anigen-encode", "writes_into": "data", "args": {"--dataset": "{data}"}}}})");
  run(p);
  fs::remove_all(job_of(p, 0, "data").folder);
  EXPECT_EQ(run(p, {1, 0, "data"}).done, 1u);
  EXPECT_FALSE(is_done(place_.out, job_of(p, 0, "latents")));
  EXPECT_EQ(run(p).done, 1u);
}

TEST_F(RunJobs, AProgramThatChangedMeanwhileStopsTheRun) {
  const Plan p = plan(kTwoVariants);
  program("anigen-train", "#!/bin/bash\necho another one\n");
  EXPECT_NE(error_of([&] { run(p); }).find("has changed since"), std::string::npos);
}

TEST_F(RunJobs, AJobThatSomebodyElseRunsIsNotRunTwice) {
  const Plan p = plan(kTwoVariants);
  const auto lock = FileLock::try_lock(job_lock_file(place_.out, job_of(p, 0, "data").id), FileLock::Kind::kExclusive);
  EXPECT_NE(error_of([&] { run(p, {1, 0, "data"}); }).find("is running data-"), std::string::npos);
  EXPECT_NE(error_of([&] { run(p, {1, 0, "../x"}); }).find("no job or step"), std::string::npos);
}

TEST_F(RunJobs, JobsAtATimeShareTheThreads) {
  const Plan p = plan(kTwoVariants);
  run(p, {3, 7, "data"});
  EXPECT_TRUE(record(job_of(p, 0, "data")).share == (CoreShare{2, 3}));
  std::ifstream stream(folder_ / "calls.txt");
  std::string line;
  std::getline(stream, line);
  EXPECT_NE(line.find("--threads 2"), std::string::npos) << line;
}

TEST_F(RunJobs, OneStepAlone) {
  const Plan p = plan(kTwoVariants);
  EXPECT_NE(error_of([&] { run(p, {1, 0, "fit"}); }).find("which is not done"), std::string::npos);
  EXPECT_NE(error_of([&] { run(p, {1, 0, "fat"}); }).find("no job or step"), std::string::npos);
  EXPECT_EQ(run(p, {1, 0, "data"}).done, 1u);
  EXPECT_EQ(run(p, {1, 0, job_of(p, 2, "fit").id}).done, 1u);
  EXPECT_EQ(calls("anigen-train"), 1u);
}

TEST_F(RunJobs, AProgramThatCannotRunFails) {
  program("anigen-train", "#!/no/such/interpreter\n");
  const RunOutcome outcome = run(plan(kTwoVariants));
  EXPECT_EQ(outcome.failed, 4u);
}

TEST_F(RunJobs, TwoAtATimeInOneFolderAreRefused) {
  const Plan p = plan(kTwoVariants);
  const auto lock = FileLock::try_lock(place_.out / "locks" / "all", FileLock::Kind::kExclusive);
  EXPECT_NE(error_of([&] { run(p); }).find("another anigen-experiment"), std::string::npos);
}

// In a process of its own: the flag that Ctrl-C raises stays up.
TEST_F(RunJobs, CtrlCLetsProgramsSaveAndTheNextRunGoesOn) {
  write("wait", "");
  const Plan p = plan(kTwoVariants);
  const auto interrupted = [&] {
    install_interrupt_handler();
    std::thread([&] {
      while (!fs::exists(folder_ / "calls.txt")) std::this_thread::sleep_for(std::chrono::milliseconds(20));
      std::raise(SIGINT);
    }).detach();
    try {
      run(p);
    } catch (const Interrupted&) {
      std::_Exit(42);
    }
    std::_Exit(1);
  };
  EXPECT_EXIT(interrupted(), ::testing::ExitedWithCode(42), "");
  EXPECT_EQ(record(job_of(p, 0, "data")).state, JobRecord::State::kInterrupted);
  EXPECT_EQ(record(job_of(p, 0, "data")).status, 130);
  fs::remove(folder_ / "wait");
  EXPECT_EQ(run(p).done, 9u);
}

TEST_F(RunJobs, OtherCodeMakesOtherJobsUnlessAccepted) {
  const Plan before = plan(kTwoVariants);
  run(before);
  program("anigen-prepare", "#!/bin/bash\nexit 1\n");
  Plan after = plan(kTwoVariants);
  EXPECT_NE(job_of(before, 0, "data").id, job_of(after, 0, "data").id);
  EXPECT_EQ(find_leftovers(place_.out, after).size(), 9u);
  EXPECT_FALSE(job_of(after, 0, "data").of_other_code);
  accept_other_code(place_.out, after);
  EXPECT_TRUE(job_of(after, 0, "data").of_other_code);
  EXPECT_EQ(run(after).kept, 9u);
  EXPECT_TRUE(find_leftovers(place_.out, after).empty());
}

TEST_F(RunJobs, CleaningRemovesWhatThePlanNoLongerNames) {
  const Plan before = plan(kTwoVariants);
  run(before);
  fs::create_directories(place_.out / "jobs" / "mine");
  std::string changed = kTwoVariants;
  changed.replace(changed.find("lr\": 2"), 6, "lr\": 7");
  const Plan after = plan(changed);
  const std::vector<Leftover> leftovers = find_leftovers(place_.out, after);
  EXPECT_EQ(leftovers.size(), 4u);  // the trainings of one variant and their evaluations
  remove_leftovers(place_.out, leftovers);
  EXPECT_FALSE(fs::exists(job_of(before, 2, "fit").folder));
  EXPECT_TRUE(fs::exists(job_of(before, 0, "fit").folder));
  EXPECT_TRUE(fs::exists(place_.out / "jobs" / "mine"));
}

}  // namespace
}  // namespace anigen::experiment
