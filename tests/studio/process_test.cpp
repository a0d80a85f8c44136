#include <gtest/gtest.h>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>
#include <string>
#include <thread>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/sandbox.h"
#include "anigen/core/worker_process.h"
#include "anigen/studio/job_process.h"
#include "anigen/studio/job_work.h"
#include "tests/support/paths.h"
#include "tests/support/scene_files.h"

namespace anigen::studio {

namespace {

namespace fs = std::filesystem;

constexpr const char* kTetrahedron = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n";

/// One job in a process, of a mesh in a folder of its own.
class StudioProcess : public ::testing::Test {
 protected:
  StudioProcess() {
    options_.command = {ANIGEN_STUDIO_PROGRAM, "--worker"};
    record_.id = "j000001";
    record_.kind = "rig";
    record_.name = "a.obj";
    record_.inputs["file"] = "input.obj";
    record_.names["file"] = "a.obj";
    record_.options = {{"method", "curve"}, {"motions", Json::array()}};
    write_file_atomically(folder_ / "input.obj", kTetrahedron);
  }

  /// A job of a rig in a format that takes Assimp, and a method that is quick.
  void use_rig() {
    record_.inputs["file"] = "input.dae";
    record_.names["file"] = record_.name = "a.dae";
    write_file_atomically(folder_ / "input.dae", test::collada_text(test::RigFile(), {}));
    record_.options = {{"method", "heat"}, {"motions", Json::array()}};
  }
  void shell(const std::string& script) { options_.command = {"/bin/sh", "-c", script}; }

  /// Sentence of the exception that the job ends with; empty: it is done. "interrupted": it was
  std::string problem() {
    JobProcesses work(options_);
    return problem_of(work);
  }
  std::string problem_of(JobProcesses& work) {
    try {
      work.run(folder_.path(), job_, record_);
    } catch (const Interrupted&) {
      return "interrupted";
    } catch (const std::exception& error) {
      return error.what();
    }
    return "";
  }
  static bool says(const std::string& text, const std::string& words) { return text.find(words) != std::string::npos; }

  test::TemporaryFolder folder_;
  JobProcessOptions options_;
  Job job_;
  JobRecord record_;
};

TEST_F(StudioProcess, DoesAJobAndLeavesItsResultAlone) {
  write_file_atomically(folder_ / "rigged.glb.tmp-1-1", "of a process that was killed");
  EXPECT_EQ(problem(), "");
  EXPECT_EQ(record_.result.value("faces", 0), 4);
  std::set<std::string> names;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_.path())) names.insert(entry.path().filename());
  EXPECT_EQ(names, (std::set<std::string>{"input.obj", "preview.png", "rigged.glb"}));
  record_.options["method"] = "heat";
  EXPECT_TRUE(says(problem(), "has no joints"));
}

TEST_F(StudioProcess, SaysHowAProcessWasLost) {
  shell("read job; kill -SEGV $$");
  EXPECT_TRUE(says(problem(), "signal 11")) << problem();
  shell("read job; exit 3");
  EXPECT_EQ(problem(), "the process of this job ended with status 3; other jobs go on");
  shell("read job; echo words; exec sleep 9");
  EXPECT_TRUE(says(problem(), "message of a worker")) << problem();
  shell("read job; echo '{\"event\": \"done\"}'");
  EXPECT_NE(problem(), "");
  options_.command = {"/no/such/program"};
  EXPECT_TRUE(says(problem(), "status 127")) << problem();
}

TEST_F(StudioProcess, SaysThatAFolderIsGone) {
  const fs::path gone = folder_ / "gone";
  JobProcesses work(options_);
  try {
    work.run(gone, job_, record_);
    FAIL() << "there is no such folder";
  } catch (const std::exception& error) {
    EXPECT_TRUE(says(error.what(), gone.string() + ": ")) << error.what();
  }
}

TEST_F(StudioProcess, EndsAJobThatPassesALimit) {
  options_.memory_bytes = 1 << 20;
  EXPECT_TRUE(says(problem(), "needed more than 0.0009766 GB of memory")) << problem();
  options_ = JobProcessOptions();
  options_.minutes = 0.002;
  shell("read job; exec sleep 60");
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_TRUE(says(problem(), "took longer than 0.002 minutes"));
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(5));
}

TEST_F(StudioProcess, KillsACancelledJobThatDoesNotStop) {
  shell("read job; read cancel; while true; do sleep 1; done");
  std::thread canceller([this] {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    job_.cancel();
  });
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_EQ(problem(), "interrupted");
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  EXPECT_GT(seconds, 2.0) << "it had time to stop by itself";
  EXPECT_LT(seconds, 4.0);
  canceller.join();
  shell("read job; read cancel; echo '{\"event\": \"interrupted\"}'");
  EXPECT_EQ(problem(), "interrupted");
}

/// Lines that the worker of a studio answers until it ends, or has answered one that is no progress.
Json last_answer(WorkerProcess& worker) {
  for (bool ended = false; !ended; std::this_thread::sleep_for(std::chrono::milliseconds(5)))
    for (const std::string& line : worker.receive(ended))
      if (const Json message = Json::parse(line); message.value("event", "") != "progress") return message;
  return nullptr;
}

TEST_F(StudioProcess, ChangesFilesInItsFolderAlone) {
  if (!sandbox_means().folders) GTEST_SKIP() << "this kernel has no Landlock";
  use_rig();
  const test::TemporaryFolder elsewhere;
  WorkerProcess worker({ANIGEN_STUDIO_PROGRAM, "--worker", folder_.path().string()});
  const auto answer = [&](const fs::path& folder) {
    worker.send(Json{{"job", to_json(record_)}, {"folder", folder.string()}, {"threads", 1}}.dump());
    return last_answer(worker);
  };
  const Json refused = answer(elsewhere.path());
  EXPECT_EQ(refused.value("event", ""), "failed");
  const std::string problem = refused.value("problem", "");
  EXPECT_TRUE(says(problem, elsewhere.path().string())) << problem << ": names the file";
  EXPECT_TRUE(says(problem, "Permission denied")) << problem;
  EXPECT_TRUE(fs::is_empty(elsewhere.path()));
  EXPECT_EQ(answer(folder_.path()).value("event", ""), "done") << "and goes on";
}

TEST_F(StudioProcess, HasNoRightsButThoseOfAJob) {
  if (!sandbox_means().calls) GTEST_SKIP() << "this kernel has no seccomp filters";
  use_rig();
  WorkerProcess worker({ANIGEN_STUDIO_PROGRAM, "--worker", folder_.path().string()});
  worker.send(Json{{"job", to_json(record_)}, {"folder", folder_.path().string()}, {"threads", 2}}.dump());
  EXPECT_EQ(last_answer(worker).value("event", ""), "done");
  int threads = 0;
  for (const fs::directory_entry& task : fs::directory_iterator("/proc/" + std::to_string(worker.id()) + "/task")) {
    std::ifstream file(task.path() / "status");
    const std::string status{std::istreambuf_iterator<char>(file), {}};
    EXPECT_TRUE(says(status, "NoNewPrivs:\t1\n")) << status;
    EXPECT_TRUE(says(status, "Seccomp:\t2\n")) << status;
    ++threads;
  }
  EXPECT_GT(threads, 1) << "the one that reads messages, too";
}

TEST_F(StudioProcess, ReadsFormatsThatTakeAProcessOfTheirOwn) {
  use_rig();
  EXPECT_EQ(problem(), "");
  EXPECT_EQ(record_.result.value("joints", 0), 3);
}

/// A worker that notes each of its starts, and does any number of jobs.
TEST_F(StudioProcess, KeepsTheProcessOfGenerationsUntilItDies) {
  const std::string answer = "echo '{\"event\": \"failed\", \"problem\": \"no\"}'";
  shell("echo started >> " + (folder_ / "starts").string() + "; while read job; do " + answer + "; done");
  const auto starts = [&] {
    std::ifstream file(folder_ / "starts");
    int count = 0;
    for (std::string line; std::getline(file, line);) ++count;
    return count;
  };
  record_.kind = "generation";
  JobProcesses work(options_);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(problem_of(work), "no");
  EXPECT_EQ(starts(), 1) << "models stay loaded";
  record_.kind = "rig";
  for (int i = 0; i < 2; ++i) EXPECT_EQ(problem_of(work), "no");
  EXPECT_EQ(starts(), 3) << "a process for each";
  fs::remove(folder_ / "starts");
  shell("echo started >> " + (folder_ / "starts").string() + "; read job; " + answer);
  record_.kind = "generation";
  JobProcesses dies(options_);
  for (int i = 0; i < 2; ++i) {
    EXPECT_EQ(problem_of(dies), "no");
    std::this_thread::sleep_for(std::chrono::milliseconds(200));
  }
  EXPECT_EQ(starts(), 2) << "it died between the two";
}

}  // namespace

}  // namespace anigen::studio
