#include "anigen/experiment/command.h"

#include <sys/wait.h>

#include <cstdlib>

#include "anigen/core/files.h"
#include "anigen/core/process.h"
#include "anigen/experiment/run_jobs.h"
#include "tests/experiment/experiment_folder.h"

namespace anigen::experiment {
namespace {

namespace fs = std::filesystem;

class Slurm : public ExperimentFolder {
 protected:
  std::vector<fs::path> emit(const Plan& p, const std::string& command = "anigen-experiment") {
    return write_slurm(place_.out, p, {command, "run", "e.json", "--only"}, folder_.path());
  }

  /// An experiment whose dataset is made by four tasks and whose training wants GPUs.
  Plan shared_plan() {
    return plan(R"({"title": "x", "steps": {
      "data": {"program": "anigen-prepare", "args": {"--procedural": 3},
               "resources": {"workers": 4, "cpus": 8, "memory_gb": 15.5, "hours": 1.5, "partition": "cpu"}},
      "fit": {"program": "anigen-train", "config": "train.json", "args": {"--dataset": "{data}"},
              "resources": {"gpus": 2, "hours": 30}}}})");
  }

  static int shell(const std::string& line) {
    const int status = std::system(line.c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  static bool contains(const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos;
  }
};

TEST_F(Slurm, ArraysWaitForTheStepsTheyNeed) {
  const Plan p = plan(kTwoVariants);
  run_jobs(place_.out, p, {1, 0, "data"});
  const auto files = emit(p);
  ASSERT_EQ(files.size(), 3u);  // trainings, evaluations, submit.sh: the dataset is done
  const std::string fit = read_file(files[0]), submit = read_file(files[2]);
  EXPECT_TRUE(contains(fit, "--array=0-3\n"));
  EXPECT_TRUE(contains(fit, job_of(p, 2, "fit").id));
  EXPECT_TRUE(contains(submit, "job_fit=$(sbatch --parsable \"$@\" 01_fit.sbatch)"));
  EXPECT_TRUE(contains(submit, "--dependency=afterok:$job_fit"));
  EXPECT_TRUE(contains(fit, "cd " + folder_.path().string()));
  for (const fs::path& file : files) EXPECT_EQ(shell("bash -n '" + file.string() + "'"), 0) << file;
}

TEST_F(Slurm, TasksShareAJobAndAskForWhatTheStepNeeds) {
  const auto files = emit(shared_plan());
  ASSERT_EQ(files.size(), 3u);
  const std::string data = read_file(files[0]), fit = read_file(files[1]);
  for (const char* line : {"#SBATCH --array=0-3\n", "#SBATCH --cpus-per-task=8\n", "#SBATCH --mem=15872M\n",
                           "#SBATCH --time=1:30:00\n", "#SBATCH --partition=cpu\n", "#SBATCH --requeue\n",
                           "#SBATCH --open-mode=append\n", "\"$job\" --together)", "workers=4"})
    EXPECT_TRUE(contains(data, line)) << line << data;
  for (const char* line : {"#SBATCH --array=0-0\n", "#SBATCH --gpus-per-node=2\n", "#SBATCH --time=30:00:00\n"})
    EXPECT_TRUE(contains(fit, line)) << line << fit;
  EXPECT_FALSE(contains(fit, "--together"));
  for (const fs::path& file : files) EXPECT_EQ(shell("bash -n '" + file.string() + "'"), 0) << file;
}

// With programs in place of SLURM's and ours that note what they are called with.
TEST_F(Slurm, AScriptRunsItsJobAndPutsItselfBackWhenItCanGoOn) {
  const std::string log = (folder_ / "log").string();
  program("scontrol", "#!/bin/bash\necho \"scontrol $*\" >> '" + log + "'\n");
  const auto run = [&](const std::string& body, int task, const std::string& before = "") {
    program("ours", "#!/bin/bash\necho \"ours $*\" >> '" + log + "'\n" + body + "\n");
    fs::remove(log);
    const auto files = emit(shared_plan(), (folder_ / "bin" / "ours").string());
    return shell(before + " PATH='" + (folder_ / "bin").string() + "':\"$PATH\" SLURM_JOB_ID=9 SLURM_ARRAY_TASK_ID=" +
                 std::to_string(task) + " bash '" + files[0].string() + "'");
  };
  const std::string id = job_of(shared_plan(), 0, "data").id;
  EXPECT_EQ(run("exit 0", 3), 0);
  EXPECT_EQ(read_file(log), "ours run e.json --only " + id + " --together\n");
  EXPECT_EQ(run("exit 130", 0), 130);
  EXPECT_TRUE(contains(read_file(log), "scontrol requeue 9"));
  EXPECT_EQ(run("exit 2", 0), 2);
  EXPECT_FALSE(contains(read_file(log), "scontrol")) << "wrong input";
  EXPECT_EQ(run("exit 1", 0), 1);
  EXPECT_TRUE(contains(read_file(log), "scontrol requeue 9"));
  EXPECT_EQ(run("exit 1", 0, "SLURM_RESTART_COUNT=2"), 1);
  EXPECT_FALSE(contains(read_file(log), "scontrol")) << "not for ever";
  // As SLURM does when time is up: a signal to the script alone, which the program gets too.
  EXPECT_EQ(run("trap 'exit 130' TERM; sleep 0.3; kill -TERM $PPID; while true; do sleep 0.02; done", 0), 130);
  EXPECT_TRUE(contains(read_file(log), "scontrol requeue 9"));
}

TEST_F(Slurm, OnlyProgramsThatShareTheirWorkTakeSeveralWorkers) {
  const auto with = [](const std::string& step) { return R"({"title": "x", "steps": {"a": )" + step + "}}"; };
  EXPECT_TRUE(contains(error_of([&] {
                         plan(with(R"({"program": "anigen-train", "config": "train.json",
                                       "resources": {"workers": 2}})"));
                       }),
                       "does not share"));
  EXPECT_TRUE(contains(error_of([&] {
                         plan(with(R"({"program": "anigen-eval", "args": {"--ss-flow": "x"},
                                       "resources": {"workers": 2}})"));
                       }),
                       "does not share"));
  EXPECT_TRUE(contains(error_of([&] { plan(with(R"({"program": "anigen-prepare", "resources": {"gpu": 2}})")); }),
                       "did you mean"));
  EXPECT_TRUE(
      contains(error_of([&] { plan(with(R"({"program": "anigen-prepare", "resources": {"partition": "a; rm"}})")); }),
               "partition"));
}

TEST_F(Slurm, ResourcesDoNotMakeOtherJobs) {
  const Plan with = shared_plan();
  const Plan without = plan(R"({"title": "x", "steps": {
      "data": {"program": "anigen-prepare", "args": {"--procedural": 3}},
      "fit": {"program": "anigen-train", "config": "train.json", "args": {"--dataset": "{data}"}}}})");
  EXPECT_EQ(job_of(with, 0, "fit").id, job_of(without, 0, "fit").id);
}

TEST_F(Slurm, TogetherAJobIsDoneWhenOneOfItsWorkersSaysSo) {
  const Plan p = plan(kTwoVariants);
  const std::string id = job_of(p, 0, "data").id;
  RunOptions options;
  options.only = id;
  options.together = true;
  const auto other = FileLock::try_lock(job_lock_file(place_.out, id), FileLock::Kind::kShared);
  EXPECT_EQ(run_jobs(place_.out, p, options).done, 1u);
  EXPECT_EQ(read_record(place_.out, id)->state, JobRecord::State::kDone);
  EXPECT_TRUE(fs::is_directory(worker_logs(place_.out, id)));
  EXPECT_EQ(run_jobs(place_.out, p, options).kept, 1u);
  options.only.clear();
  EXPECT_TRUE(contains(error_of([&] { run_jobs(place_.out, p, options); }), "--only"));
}

}  // namespace
}  // namespace anigen::experiment
