#include "anigen/studio/job_process.h"

#include <poll.h>
#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <deque>
#include <exception>
#include <fstream>
#include <iostream>
#include <mutex>
#include <new>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/sandbox.h"
#include "anigen/core/table.h"
#include "anigen/studio/job_work.h"

namespace anigen::studio {

namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

/// Interval between looks at memory, time and cancelling. A job that allocates 4 GB/s overshoots its limit by 100 MB.
constexpr int kLookMilliseconds = 25;
constexpr double kGraceSeconds = 2.0;
constexpr std::uint64_t kLargestFile = std::uint64_t{4} << 30;  // many times what a job writes
constexpr int kMoreFiles = 512;
constexpr int kEndedEarlier = 500;  // oom_score_adj: when memory runs out, jobs go before the server

double seconds_since(Clock::time_point begin) { return std::chrono::duration<double>(Clock::now() - begin).count(); }

void take_outcome(const Json& outcome, JobRecord& record) {
  if (outcome.at("event") == "interrupted") throw Interrupted("cancelled");
  if (outcome.at("event") == "failed") throw Error(outcome.value("problem", ""));
  const JobRecord done = job_record_from_json(outcome.at("job"), "message of a worker");
  record.note = done.note;
  record.result = done.result;
  record.scores = done.scores;
}

}  // namespace

std::unique_ptr<WorkerProcess> JobProcesses::start(const fs::path& writable) const {
  std::vector<std::string> command = options_.command;
  command.push_back(writable.string());
  return std::make_unique<WorkerProcess>(command, true);
}

void JobProcesses::refuse_excess(WorkerProcess& process, double seconds) const {
  std::string excess;
  if (seconds > 60.0 * options_.minutes)
    excess = "took longer than " + significant(options_.minutes, 4) + " minutes (--job-minutes)";
  else if (process.resident_bytes() > options_.memory_bytes)
    excess = "needed more than " + significant(static_cast<double>(options_.memory_bytes) / (1 << 30), 4) +
             " GB of memory (--job-memory)";
  if (excess.empty()) return;
  process.kill();
  throw Error("the job " + excess + " and was ended");
}

/// The last message of the job, or null when it was cancelled and its process killed.
Json JobProcesses::outcome(WorkerProcess& process, const fs::path& folder, Job& job, const JobRecord& record) const {
  const Clock::time_point begin = Clock::now();
  std::optional<Clock::time_point> cancelled;
  process.send(Json{{"job", to_json(record)}, {"folder", folder.string()}, {"threads", options_.threads}}.dump());
  for (bool ended = false; !ended;) {
    if (job.cancelled() && !cancelled) {
      cancelled = Clock::now();
      process.send(R"({"cancel": true})");
    }
    if (cancelled && seconds_since(*cancelled) > kGraceSeconds) {
      process.kill();
      return nullptr;
    }
    refuse_excess(process, seconds_since(begin));
    pollfd watched{process.output(), POLLIN, 0};
    ::poll(&watched, 1, kLookMilliseconds);
    for (const std::string& line : process.receive(ended)) {
      Json message = parse_json(line, "message of a worker");
      if (message.value("event", "") != "progress") return message;
      job.report(message.value("stage", ""), message.value("fraction", 0.0));
    }
  }
  const std::string end = process.wait();
  if (cancelled) return nullptr;
  throw Error("the process of this job " + end + "; other jobs go on");
}

void JobProcesses::run(const fs::path& folder, Job& job, JobRecord& record) {
  remove_leftovers(folder);
  const bool keeps = record.kind == "generation";
  std::unique_ptr<WorkerProcess> process;
  if (keeps && warm_) {
    process = std::move(warm_);
    bool ended = false;
    process->receive(ended);
    if (ended) process.reset();
  }
  if (!process) process = start(keeps ? folder.parent_path() : folder);
  Json last;
  try {
    last = outcome(*process, folder, job, record);
  } catch (...) {
    process.reset();
    remove_leftovers(folder);
    throw;
  }
  const bool killed = last.is_null();
  if (keeps && !killed) warm_ = std::move(process);
  process.reset();
  remove_leftovers(folder);
  if (killed) throw Interrupted("cancelled");
  take_outcome(last, record);
}

namespace {

/// Jobs that the server sends, read by a thread of their own so that cancelling is heard while one is at work.
class Inbox {
 public:
  Inbox() : reader_([this] { read(); }) {}
  ~Inbox() { reader_.detach(); }
  Inbox(const Inbox&) = delete;
  Inbox& operator=(const Inbox&) = delete;

  Json next() {
    std::unique_lock<std::mutex> lock(mutex_);
    arrived_.wait(lock, [this] { return !jobs_.empty(); });
    Json job = std::move(jobs_.front());
    jobs_.pop_front();
    return job;
  }
  /// The job that a cancel is for, also one that came before it began.
  void set_current(Job* job) {
    const std::lock_guard<std::mutex> lock(mutex_);
    current_ = job;
    if (job != nullptr && cancelled_) job->cancel();
  }

 private:
  void read() {
    for (std::string line; std::getline(std::cin, line);) {
      const Json message = Json::parse(line, nullptr, false);
      const std::lock_guard<std::mutex> lock(mutex_);
      cancelled_ = message.contains("cancel");
      if (message.contains("job")) jobs_.push_back(message);
      if (cancelled_ && current_ != nullptr) current_->cancel();
      arrived_.notify_all();
    }
    std::_Exit(0);  // the server is gone, or needs no worker any more
  }

  std::mutex mutex_;
  std::condition_variable arrived_;
  std::deque<Json> jobs_;
  Job* current_ = nullptr;
  bool cancelled_ = false;  ///< the last message is a cancel
  std::thread reader_;
};

Json outcome_of(JobWork& work, const Json& message, Job& job) {
  try {
    JobRecord record = job_record_from_json(message.at("job"), "job of a worker");
    const fs::path folder = message.at("folder").get<std::string>();
    // Files of the readers, which a process that is killed cannot remove.
    fs::create_directories(folder / kScratchFolder);
    ::setenv("TMPDIR", (folder / kScratchFolder).c_str(), 1);
    set_thread_count(message.at("threads").get<int>());
    work.run(folder, job, record);
    return {{"event", "done"}, {"job", to_json(record)}};
  } catch (const Interrupted&) {
    return {{"event", "interrupted"}};
  } catch (const std::bad_alloc&) {
    return {{"event", "failed"}, {"problem", "out of memory"}};
  } catch (const std::exception& error) {
    return {{"event", "failed"}, {"problem", error.what()}};
  }
}

}  // namespace

int run_job_worker(const fs::path& writable) {
  const WorkerMessages messages;
  log::setup("warn");
  Progress::set_quiet(true);
  std::ofstream("/proc/self/oom_score_adj") << kEndedEarlier;
  SandboxRights rights;
  rights.writable = {writable};
  rights.processes = true;  // Assimp has one of its own
  rights.file_bytes = kLargestFile;
  rights.more_files = kMoreFiles;
  std::string refusal;
  try {
    enter_sandbox(rights);
  } catch (const std::exception& error) {
    refusal = error.what();
  }
  Inbox inbox;
  JobWork work;
  for (;;) {
    const Json message = inbox.next();
    if (!refusal.empty()) {
      messages.send({{"event", "failed"}, {"problem", refusal}});
      std::_Exit(1);  // the next job gets a new process
    }
    Job job([&messages](const std::string& stage, double fraction) {
      messages.send({{"event", "progress"}, {"stage", stage}, {"fraction", fraction}});
    });
    inbox.set_current(&job);
    const Json outcome = outcome_of(work, message, job);
    inbox.set_current(nullptr);
    messages.send(outcome);
  }
}

}  // namespace anigen::studio
