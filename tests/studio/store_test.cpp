#include <gtest/gtest.h>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/process.h"
#include "anigen/studio/job_runner.h"
#include "anigen/studio/job_store.h"
#include "anigen/studio/time_left.h"
#include "tests/support/paths.h"

namespace anigen::studio {

namespace {

namespace fs = std::filesystem;

JobRecord mesh_job(const std::string& name) {
  JobRecord record;
  record.kind = "rig";
  record.name = name;
  record.options = {{"method", "curve"}};
  return record;
}

std::vector<InputFile> obj(const std::string& text) { return {{"file", ".obj", text}}; }

bool soon(const std::function<bool()>& condition) {
  for (int i = 0; i < 1000; ++i) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return false;
}

bool reaches(const JobStore& store, const std::string& id, JobState state) {
  return soon([&] { return store.find(id)->state == state; });
}

class StudioStore : public ::testing::Test {
 protected:
  test::TemporaryFolder folder_;
};

TEST_F(StudioStore, KeepsJobsOverARestart) {
  std::string id;
  {
    JobStore store(folder_.path());
    const JobRecord made = store.create(mesh_job("fox.obj"), obj("v 0 0 0\n"));
    id = made.id;
    store.update(id, [](JobRecord& record) {
      record.state = JobState::kDone;
      record.note = "by hand";
      record.result = {{"joints", 3}};
    });
    EXPECT_THROW(JobStore other(folder_.path()), InputError);
  }
  JobStore store(folder_.path());
  const std::optional<JobRecord> found = store.find(id);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->state, JobState::kDone);
  EXPECT_EQ(found->note, "by hand");
  EXPECT_EQ(found->options, mesh_job("").options);
  EXPECT_EQ(found->result.at("joints"), 3);
  EXPECT_EQ(read_file(store.folder(id) / found->inputs.at("file")), "v 0 0 0\n");
  EXPECT_NE(store.create(mesh_job("b.obj"), obj("x")).id, id);
}

TEST_F(StudioStore, SettlesWhatAKilledStudioLeft) {
  std::string first, again, damaged, cancelled;
  {
    JobStore store(folder_.path());
    for (std::string* id : {&first, &again, &damaged, &cancelled}) *id = store.create(mesh_job("a.obj"), obj("x")).id;
    store.update(first, [](JobRecord& record) { record.state = JobState::kRunning, record.starts = 1; });
    store.update(again, [](JobRecord& record) { record.state = JobState::kRunning, record.starts = 2; });
    store.update(cancelled, [](JobRecord& record) { record.state = JobState::kRunning, record.cancelling = true; });
    write_file_atomically(store.folder(first) / "scratch/input.obj", "of a process that was killed");
    write_file_atomically(store.folder(damaged) / "job.json", "{\"id\": ");
    write_file_atomically(folder_ / "jobs/j000099/input.obj", "never accepted");
  }
  JobStore store(folder_.path());
  EXPECT_EQ(store.find(first)->state, JobState::kQueued);
  EXPECT_FALSE(fs::exists(store.folder(first) / "scratch"));
  EXPECT_EQ(store.find(again)->state, JobState::kFailed);
  EXPECT_EQ(store.find(cancelled)->state, JobState::kCancelled);
  EXPECT_NE(store.find(again)->error.find("ended 2 times"), std::string::npos);
  EXPECT_EQ(store.find(damaged)->state, JobState::kFailed);
  EXPECT_NE(store.find(damaged)->error.find("job.json"), std::string::npos);
  EXPECT_FALSE(store.find("j000099"));
  EXPECT_FALSE(fs::exists(folder_ / "jobs/j000099"));
  EXPECT_FALSE(store.remove(first)) << "it waits";
  EXPECT_TRUE(store.remove(again));
  EXPECT_FALSE(fs::exists(store.folder(again)));
}

TEST_F(StudioStore, LeavesFilesThatThisProcessWrites) {
  const fs::path folder = folder_ / "job";
  const std::string own = "job.tmp-" + process_number() + "-7.json";
  write_file_atomically(folder / own, "half a record");
  write_file_atomically(folder / "rigged.tmp-1-1.glb", "of a process that was killed");
  remove_leftovers(folder);
  EXPECT_TRUE(fs::exists(folder / own));
  EXPECT_FALSE(fs::exists(folder / "rigged.tmp-1-1.glb"));
  const AtomicFile written(folder / "job.json");
  EXPECT_NE(written.temporary().filename().string().find(".tmp-" + process_number() + "-"), std::string::npos);
}

TEST_F(StudioStore, AdoptsAJobThatAnotherStoreHasDone) {
  const test::TemporaryFolder other;
  fs::path from;
  {
    JobStore store(other.path());
    const std::string id = store.create(mesh_job("cat.obj"), obj("x")).id;
    from = store.folder(id);
    EXPECT_THROW(JobStore(folder_.path()).adopt(from), InputError) << "it waits";
    write_file_atomically(from / "rigged.glb", "glb");
    store.update(id, [](JobRecord& record) {
      record.state = JobState::kDone;
      record.started = 10.0;
      record.ended = 12.5;
    });
  }
  {
    JobStore store(folder_.path());
    store.create(mesh_job("first.obj"), obj("y"));
    const JobRecord adopted = store.adopt(from);
    EXPECT_EQ(adopted.id, "j000002");
    EXPECT_NEAR(adopted.ended, seconds_now(), 60.0);
    EXPECT_DOUBLE_EQ(adopted.ended - adopted.started, 2.5);
    EXPECT_THROW(store.adopt(folder_ / "nowhere"), Error);
  }
  const JobStore again(folder_.path());
  EXPECT_EQ(again.find("j000002")->name, "cat.obj");
  EXPECT_EQ(read_file(again.folder("j000002") / "rigged.glb"), "glb");
}

TEST_F(StudioStore, RunnerRunsWhatWaitedAndCountsFailures) {
  std::string good, bad;
  {
    JobStore store(folder_.path());
    good = store.create(mesh_job("good.obj"), obj("x")).id;
    bad = store.create(mesh_job("bad.obj"), obj("x")).id;
  }
  JobStore store(folder_.path());
  JobRunner runner(store, [&](const fs::path&, Job& job, JobRecord& record) {
    job.report("binding", 0.5);
    if (record.name == "bad.obj") throw InputError("bad.obj", "line 1", "is \xff no mesh");
    record.note = "made";
  });
  EXPECT_TRUE(reaches(store, good, JobState::kDone));
  EXPECT_TRUE(reaches(store, bad, JobState::kFailed));
  EXPECT_EQ(store.find(good)->note, "made");
  EXPECT_EQ(store.find(bad)->error.rfind("bad.obj", 0), 0U);
  EXPECT_FALSE(runner.cancel(good));
}

TEST_F(StudioStore, RunnerCancelsOneJobAndBoundsItsQueue) {
  JobStore store(folder_.path());
  JobRunner runner(
      store,
      [](const fs::path&, Job& job, JobRecord&) {
        job.report("waiting", 0.25);
        while (!job.cancelled()) std::this_thread::sleep_for(std::chrono::milliseconds(2));
        throw Interrupted("cancelled");
      },
      2);
  const std::string running = runner.submit(mesh_job("a.obj"), obj("x"))->id;
  EXPECT_TRUE(soon([&] { return runner.progress(running) && runner.progress(running)->fraction == 0.25; }));
  EXPECT_EQ(runner.progress(running)->stage, "waiting");
  const std::string waiting = runner.submit(mesh_job("b.obj"), obj("x"))->id;
  EXPECT_TRUE(runner.submit(mesh_job("c.obj"), obj("x")));
  EXPECT_FALSE(runner.submit(mesh_job("d.obj"), obj("x"))) << "two wait already";
  EXPECT_TRUE(runner.cancel(waiting));
  EXPECT_EQ(store.find(waiting)->state, JobState::kCancelled);
  EXPECT_TRUE(runner.cancel(running));
  EXPECT_TRUE(reaches(store, running, JobState::kCancelled));
  EXPECT_FALSE(runner.cancel(running)) << "it has ended";
  EXPECT_TRUE(runner.submit(mesh_job("d.obj"), obj("x")));
}

/// From now on the disk refuses the record of a job: its name is taken by a folder.
void refuse_record(const fs::path& job) {
  fs::remove(job / "job.json");
  fs::create_directory(job / "job.json");
}

TEST_F(StudioStore, RunnerEndsAJobWhoseRecordTheDiskRefuses) {
  JobStore store(folder_.path());
  const std::string never_begun = store.create(mesh_job("a.obj"), obj("x")).id;
  refuse_record(store.folder(never_begun));
  std::atomic<int> works{0};
  JobRunner runner(store, [&](const fs::path& place, Job&, JobRecord&) {
    ++works;
    refuse_record(place);
  });
  const std::string done = runner.submit(mesh_job("b.obj"), obj("x"))->id;
  for (const std::string& id : {never_begun, done}) {
    EXPECT_TRUE(reaches(store, id, JobState::kFailed));
    EXPECT_NE(store.find(id)->error.find("job.json"), std::string::npos) << store.find(id)->error;
    EXPECT_GT(store.find(id)->ended, 0.0);
    EXPECT_TRUE(soon([&] { return !runner.progress(id); })) << "it runs no more";
    EXPECT_TRUE(store.remove(id));
  }
  EXPECT_EQ(works, 1);
}

TEST_F(StudioStore, RunnerKeepsAJobWaitingThatItCannotCancel) {
  JobStore store(folder_.path());
  std::atomic<bool> goes_on{false};
  JobRunner runner(store, [&](const fs::path&, Job& job, JobRecord&) {
    while (!goes_on && !job.cancelled()) std::this_thread::sleep_for(std::chrono::milliseconds(2));
  });
  const std::string running = runner.submit(mesh_job("a.obj"), obj("x"))->id;
  EXPECT_TRUE(reaches(store, running, JobState::kRunning));
  const std::string first = runner.submit(mesh_job("b.obj"), obj("x"))->id;
  const std::string second = runner.submit(mesh_job("c.obj"), obj("x"))->id;
  for (const std::string& id : {first, second}) {
    refuse_record(store.folder(id));
    EXPECT_THROW(runner.cancel(id), Error);
    EXPECT_EQ(store.find(id)->state, JobState::kQueued);
    fs::remove(store.folder(id) / "job.json");
  }
  EXPECT_TRUE(runner.cancel(second));
  EXPECT_EQ(store.find(second)->state, JobState::kCancelled);
  goes_on = true;
  EXPECT_TRUE(reaches(store, first, JobState::kDone)) << "it still waits";
}

TEST_F(StudioStore, StoppedRunnerLeavesItsJobForTheNextStart) {
  std::string id;
  {
    JobStore store(folder_.path());
    JobRunner runner(store, [](const fs::path&, Job& job, JobRecord&) {
      while (!job.cancelled()) std::this_thread::sleep_for(std::chrono::milliseconds(2));
      throw Interrupted("cancelled");
    });
    id = runner.submit(mesh_job("a.obj"), obj("x"))->id;
    EXPECT_TRUE(reaches(store, id, JobState::kRunning));
    runner.stop();
    EXPECT_EQ(store.find(id)->state, JobState::kQueued);
    EXPECT_EQ(store.find(id)->starts, 0) << "a stop is no crash";
  }
  JobStore store(folder_.path());
  JobRunner runner(store, [](const fs::path&, Job&, JobRecord&) {});
  EXPECT_TRUE(reaches(store, id, JobState::kDone));
}

TEST(StudioTimeLeft, IsThatOfTheStagesThatAreLeft) {
  const Timeline alike{{{"loading", 0.0}, {"structure", 4.0}, {"motions", 10.0}}, 12.0};
  EXPECT_DOUBLE_EQ(seconds_left(alike, {{"loading", 0.0}, {"structure", 3.0}}, 0.5, 99.0).value(), 5.0);
  EXPECT_DOUBLE_EQ(seconds_left(alike, {{"structure", 3.0}}, 0.0, 5.0).value(), 6.0) << "2 of its 6 s, and 2 behind";
  EXPECT_DOUBLE_EQ(seconds_left(alike, {{"motions", 3.0}}, 0.0, 50.0).value(), 0.0);
  EXPECT_FALSE(seconds_left(alike, {{"voxels", 0.0}}, 0.5, 1.0));
  EXPECT_FALSE(seconds_left(alike, {}, 0.0, 1.0));
  JobRecord other = mesh_job("a.obj"), heat = other, ended = other;
  heat.options["method"] = "heat";
  ended.state = heat.state = JobState::kDone;
  ended.stages = heat.stages = {{"rigging", 0.5}};
  ended.started = heat.started = 100.0;
  ended.ended = heat.ended = 103.0;
  EXPECT_FALSE(timeline_alike({other, heat}, other));
  ended.ended = 107.0;
  EXPECT_DOUBLE_EQ(timeline_alike({ended, other, heat}, other).value().seconds, 7.0);
}

}  // namespace

}  // namespace anigen::studio
