#include "anigen/experiment/run_jobs.h"

#include <algorithm>
#include <chrono>
#include <ctime>
#include <fstream>
#include <iterator>
#include <list>
#include <map>
#include <set>
#include <system_error>
#include <thread>
#include <utility>

#include "anigen/core/config.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/process.h"
#include "anigen/core/text.h"
#include "anigen/experiment/command.h"

namespace anigen::experiment {

namespace {

namespace fs = std::filesystem;

/// Bytes of the files under a folder; what vanishes meanwhile, or cannot be read, counts nothing.
std::uint64_t folder_size(const fs::path& folder) {
  std::uint64_t bytes = 0;
  std::error_code error;
  fs::recursive_directory_iterator entry(folder, fs::directory_options::skip_permission_denied, error);
  for (; !error && entry != fs::recursive_directory_iterator(); entry.increment(error)) {
    std::error_code unreadable;
    if (!entry->is_regular_file(unreadable)) continue;
    const std::uintmax_t size = entry->file_size(unreadable);
    if (!unreadable) bytes += size;
  }
  return bytes;
}

std::string line_of(const fs::path& file, const std::string& name) {
  return name + " " + std::to_string(fs::file_size(file)) + " " +
         std::to_string(fs::last_write_time(file).time_since_epoch().count()) + "\n";
}

/// Clears so many bytes behind each place where a mark is found.
void clear_behind(std::string& bytes, const std::string& mark, std::size_t count) {
  for (std::size_t at = bytes.find(mark); at != std::string::npos; at = bytes.find(mark, at + mark.size())) {
    for (std::size_t i = at + mark.size(); i < std::min(bytes.size(), at + mark.size() + count); ++i) bytes[i] = '\0';
  }
}

/// The program's file without what changes although the code does not.
std::string code_of(std::string bytes) {
  // As cmake/AnigenVersion.cmake writes it; put together here, so that this program holds it once.
  const std::string mark = std::string("anigen ") + "commit: ";
  constexpr std::size_t kStamp = 64;
  clear_behind(bytes, mark, kStamp - mark.size());
  // The ELF note of 20 bytes that is called GNU and is of kind 3, a build id.
  clear_behind(bytes, std::string("\4\0\0\0\24\0\0\0\3\0\0\0GNU\0", 16), 20);
  return bytes;
}

constexpr const char* kWords[] = {"begun", "done", "failed", "interrupted"};

/// A command without its program.
std::string arguments_of(const std::string& command) {
  const std::size_t space = command.find(' ');
  return space == std::string::npos ? "" : command.substr(space);
}

using Clock = std::chrono::steady_clock;

constexpr auto kPollEvery = std::chrono::milliseconds(100);

double seconds_since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

/// Jobs of the plan on their way from waiting to done.
class JobRunner {
 public:
  JobRunner(const fs::path& out, const Plan& plan, const RunOptions& options)
      : out_(out), plan_(plan), options_(options), states_(plan.jobs.size(), State::kWaiting) {
    choose();
  }

  RunOutcome run() {
    auto told = Clock::now();
    while (true) {
      if (interrupt_requested()) stop();
      collect();
      start_ready();
      if (running_.empty()) break;
      if (seconds_since(told) >= options_.report_every) {
        for (const Running& job : running_) tell(job);
        told = Clock::now();
      }
      std::this_thread::sleep_for(kPollEvery);
    }
    for (const State state : states_) outcome_.skipped += state == State::kWaiting ? 1 : 0;
    return outcome_;
  }

 private:
  enum class State { kWaiting, kRunning, kDone, kFailed, kNotAsked };
  struct Running {
    std::size_t job;
    FileLock lock;
    ChildProcess process;
    fs::path log;
    JobRecord record;
    Clock::time_point started;
  };

  void choose() {
    bool any = false;
    for (std::size_t j = 0; j < plan_.jobs.size(); ++j) {
      const Job& job = plan_.jobs[j];
      const bool asked = options_.only.empty() || options_.only == job.id || options_.only == job.step;
      any = any || asked;
      if (is_done(out_, job) && !lost_its_folder(job)) {
        states_[j] = State::kDone;
        outcome_.kept += asked ? 1 : 0;
      } else if (!asked) {
        states_[j] = State::kNotAsked;
      }
      to_run_ += states_[j] == State::kWaiting ? 1 : 0;
    }
    if (!any) throw InputError("", "--only", "no job or step of this experiment is called '" + options_.only + "'");
    if (options_.only.empty()) return;
    for (std::size_t j = 0; j < plan_.jobs.size(); ++j) {
      if (states_[j] != State::kWaiting) continue;
      for (const std::size_t need : plan_.jobs[j].needs) {
        if (states_[need] == State::kNotAsked)
          throw InputError("", "--only", plan_.jobs[j].id + " needs " + plan_.jobs[need].id + ", which is not done");
      }
    }
  }

  /// Results written into another job's folder are gone when that job has to be run again.
  bool lost_its_folder(const Job& job) const {
    return job.writes_into_other && std::any_of(job.needs.begin(), job.needs.end(), [&](std::size_t need) {
             return plan_.jobs[need].folder == job.folder && states_[need] != State::kDone;
           });
  }

  void forget_what_was_written_into(const Job& owner) {
    if (owner.writes_into_other) return;
    for (const Job& job : plan_.jobs) {
      if (job.writes_into_other && job.folder == owner.folder) remove_lastingly(record_file(out_, job.id));
    }
  }

  bool ready(const Job& job) const {
    return std::all_of(job.needs.begin(), job.needs.end(),
                       [&](std::size_t need) { return states_[need] == State::kDone; });
  }

  void start_ready() {
    for (std::size_t j = 0; j < states_.size() && running_.size() < options_.at_once; ++j) {
      if (states_[j] == State::kWaiting && ready(plan_.jobs[j])) start(j);
    }
  }

  void start(std::size_t j) {
    const Job& job = plan_.jobs[j];
    auto lock = FileLock::try_lock(job_lock_file(out_, job.id),
                                   options_.together ? FileLock::Kind::kShared : FileLock::Kind::kExclusive);
    if (!lock) throw InputError(out_.string(), "", "another anigen-experiment is running " + job.id);
    if (input_fingerprint(job.command.front()) != job.program_state) {
      throw InputError(job.command.front(), "",
                       "has changed since this run began; the same command makes a new plan and goes on");
    }
    JobRecord record = read_record(out_, job.id).value_or(JobRecord{});
    if (record.state == JobRecord::State::kDone) record = {};  // its results are gone: nothing of it is continued
    forget_what_was_written_into(job);
    record.state = JobRecord::State::kBegun;
    record.step = job.step;
    record.key = job.key;
    record.content = job.content;
    record.expected_seconds = job.minutes * 60;
    record.command = shell_line(job.command);
    record.started = utc_now();
    record.finished.clear();
    const CoreShare share = share_of_one();
    const bool changed = record.attempts > 0 && !(record.share == share);
    record.share = changed ? CoreShare{CoreShare::kChanged, CoreShare::kChanged} : share;
    ++record.attempts;
    write_record(out_, job.id, record);
    states_[j] = State::kRunning;
    log::info("[{}/{}] {}{}", ++begun_, to_run_, job.id, of_whom(job));
    const fs::path log = log_of(job);
    ChildProgram program;
    program.words = command_of(job);
    program.log = log;
    running_.push_back({j, std::move(*lock), ChildProcess(program), log, record, Clock::now()});
  }

  /// Several processes do not append to one file: on a shared file system lines would be lost.
  fs::path log_of(const Job& job) const {
    return options_.together ? worker_logs(out_, job.id) / (process_number() + ".log") : log_file(out_, job.id);
  }

  /// With the job's share of the cores, where there is something to share.
  std::vector<std::string> command_of(const Job& job) const {
    std::vector<std::string> command = words_to_run(job);
    if (options_.threads == 0 && options_.at_once == 1) return command;
    command.insert(command.end(), {"--threads", std::to_string(share_of_one().threads)});
    return command;
  }

  CoreShare share_of_one() const {
    const int cores = options_.threads > 0 ? options_.threads : thread_count(),
              jobs = static_cast<int>(options_.at_once);
    return {std::max(1, cores / jobs), jobs};
  }

  static std::string of_whom(const Job& job) {
    const std::string& first = job.serves.front();
    if (first.empty()) return "";
    return " (" + first + (job.serves.size() > 1 ? " and " + std::to_string(job.serves.size() - 1) + " more" : "") +
           ")";
  }

  void tell(const Running& running) const {
    log::info("  {} {}: {}", plan_.jobs[running.job].id, duration_text(seconds_since(running.started)),
              last_line(running.log, 100));
  }

  void collect() {
    for (auto running = running_.begin(); running != running_.end();) {
      const auto end = running->process.poll();
      if (!end) {
        ++running;
        continue;
      }
      finish(*running, *end, false);
      running = running_.erase(running);
    }
  }

  void finish(Running& running, const ChildProcess::End& end, bool stopped) {
    const Job& job = plan_.jobs[running.job];
    JobRecord& record = running.record;
    record.seconds += seconds_since(running.started);
    record.peak_bytes = std::max(record.peak_bytes, end.peak_bytes);
    record.status = end.status;
    record.finished = utc_now();
    record.state = end.status == 0 ? JobRecord::State::kDone
                   : stopped       ? JobRecord::State::kInterrupted
                                   : JobRecord::State::kFailed;
    if (end.status == 0) record.disk_bytes = job.writes_into_other ? 0 : folder_size(job.folder);
    // An event of this process says nothing about a job that another one has finished.
    const bool done_elsewhere = options_.together && end.status != 0 && is_done(out_, job);
    if (!done_elsewhere) write_record(out_, job.id, record);
    states_[running.job] = end.status == 0 ? State::kDone : State::kFailed;
    if (end.status == 0) {
      ++outcome_.done;
      log::info("  {} done in {}", job.id, duration_text(record.seconds));
    } else if (!stopped) {
      ++outcome_.failed;
      if (end.status == 2) ++outcome_.refused;
      log::error("  {} failed with status {}: {} ({})", job.id, end.status, last_line(running.log, 300),
                 running.log.string());
    }
  }

  [[noreturn]] void stop() {
    log::info("stopping: {} running jobs save their state", running_.size());
    for (Running& running : running_) running.process.ask_to_stop();
    for (Running& running : running_) {
      auto end = running.process.poll();
      for (; !end; end = running.process.poll()) std::this_thread::sleep_for(kPollEvery);
      finish(running, *end, true);
    }
    running_.clear();
    throw Interrupted("interrupted; the same command goes on from here");
  }

  const fs::path& out_;
  const Plan& plan_;
  const RunOptions& options_;
  std::vector<State> states_;
  std::list<Running> running_;
  std::size_t to_run_ = 0, begun_ = 0;
  RunOutcome outcome_;
};

}  // namespace

std::string input_fingerprint(const fs::path& path) {
  std::error_code error;
  if (fs::is_regular_file(path, error)) return sha256(line_of(path, path.filename().string()));
  if (!fs::is_directory(path, error)) throw InputError(path.string(), "", "no such file or folder");
  std::vector<std::string> lines;
  for (const auto& entry : fs::recursive_directory_iterator(path)) {
    if (entry.is_regular_file()) lines.push_back(line_of(entry.path(), fs::relative(entry.path(), path).string()));
  }
  std::sort(lines.begin(), lines.end());
  Sha256 all;
  for (const std::string& line : lines) all.update(line);
  return all.finish();
}

std::string program_fingerprint(const fs::path& program) {
  static std::map<std::string, std::string> known;  // by path, size and time
  std::error_code error;
  std::vector<fs::path> modules;
  for (const char* name : {"anigen-torch.so", "anigen-opencv.so"}) {
    // A change to networks must not make whole datasets anew: the steps of a preparation have versions of their own.
    if (program.filename() == "anigen-prepare" && std::string(name) == "anigen-torch.so") continue;
    const fs::path module = program.parent_path().parent_path() / "lib" / "anigen" / name;
    if (fs::exists(module, error)) modules.push_back(module);
  }
  std::string state = program.string() + (fs::exists(program, error) ? input_fingerprint(program) : "");
  for (const fs::path& module : modules) state += input_fingerprint(module);
  const auto found = known.find(state);
  if (found != known.end()) return found->second;
  if (!fs::is_regular_file(program, error))
    throw InputError(program.string(), "", "no such program; build it, or name its folder with --programs");
  std::string code = sha256(code_of(read_file(program)));
  for (const fs::path& module : modules) code = sha256(code + sha256(code_of(read_file(module))));
  return known[state] = code;
}

void JobRecord::fields(ConfigFields& f) {
  std::vector<std::pair<std::string, State>> words;
  for (const State one : {State::kBegun, State::kDone, State::kFailed, State::kInterrupted})
    words.emplace_back(word_of(one), one);
  f("state", state, words);
  f("step", step);
  f("key", key);
  f("content", content);
  f("command", command);
  f("started", started);
  f("finished", finished);
  f("seconds", seconds, {0.0});
  f("expected_seconds", expected_seconds, {0.0});
  f("peak_bytes", peak_bytes, {0});
  f("disk_bytes", disk_bytes, {0});
  f("threads", share.threads, {CoreShare::kChanged, 1 << 20});
  f("at_once", share.at_once, {CoreShare::kChanged, 1 << 20});
  f("attempts", attempts, {0, 1 << 20});
  f("status", status, {-256, 256});
}

std::string CoreShare::text() const {
  if (threads == kChanged) return "several attempts on other numbers of threads";
  if (threads == kUnknown) return "an unknown number of threads";
  return std::to_string(threads) + (threads == 1 ? " thread" : " threads") +
         ", jobs at once: " + std::to_string(at_once);
}

const char* word_of(JobRecord::State state) { return kWords[static_cast<int>(state)]; }

fs::path record_file(const fs::path& out, const std::string& id) { return out / "records" / (id + ".json"); }
fs::path log_file(const fs::path& out, const std::string& id) { return out / "records" / (id + ".log"); }
fs::path worker_logs(const fs::path& out, const std::string& id) { return out / "records" / (id + ".workers"); }

fs::path run_lock_file(const fs::path& out) { return out / "locks" / "all"; }
fs::path job_lock_file(const fs::path& out, const std::string& id) { return out / "locks" / id; }

std::vector<std::string> recorded_jobs(const fs::path& out) {
  std::vector<std::string> ids;
  std::error_code error;
  if (!fs::is_directory(out / "records", error)) return ids;
  for (const auto& entry : fs::directory_iterator(out / "records")) {
    const std::string id = entry.path().stem().string();
    // Other names are records that are being written.
    if (entry.path().extension() == ".json" && is_job_id(id)) ids.push_back(id);
  }
  std::sort(ids.begin(), ids.end());
  return ids;
}

std::optional<JobRecord> read_record(const fs::path& out, const std::string& id) {
  const fs::path file = record_file(out, id);
  std::error_code error;
  if (!fs::exists(file, error)) return std::nullopt;
  return JobRecord::from_json(read_json(file), file.string());
}

void write_record(const fs::path& out, const std::string& id, const JobRecord& record) {
  write_config(record_file(out, id), record.to_json());
}

std::vector<std::string> words_to_run(const Job& job) {
  std::vector<std::string> words = job.command;
  const bool forced = std::find(words.begin(), words.end(), "--force") != words.end();
  if (job.program == "anigen-generate" && !forced) words.emplace_back("--accept-other-code");
  return words;
}

std::string last_line(const fs::path& log, std::size_t most) {
  std::ifstream stream(log, std::ios::binary | std::ios::ate);
  if (!stream) return "";
  constexpr std::streamoff kTail = 4096;
  const std::streamoff size = stream.tellg();
  stream.seekg(std::max<std::streamoff>(0, size - kTail));
  std::string text((std::istreambuf_iterator<char>(stream)), {});
  while (!text.empty() && (text.back() == '\n' || text.back() == '\r' || text.back() == ' ')) text.pop_back();
  const std::size_t line = text.find_last_of("\r\n");
  if (line != std::string::npos) text.erase(0, line + 1);
  return text.size() <= most ? text : text.substr(0, most - 3) + "...";
}

bool is_done(const fs::path& out, const Job& job) {
  std::error_code error;
  if (!fs::is_directory(job.folder, error)) return false;
  const std::optional<JobRecord> record = read_record(out, job.id);
  return record && record->state == JobRecord::State::kDone;
}

void accept_other_code(const fs::path& out, Plan& plan) {
  std::multimap<std::string, std::string> by_content;  // of what is done
  for (const std::string& id : recorded_jobs(out)) {
    const std::optional<JobRecord> record = read_record(out, id);
    if (record && record->state == JobRecord::State::kDone) by_content.emplace(record->content, id);
  }
  std::vector<std::pair<std::string, std::string>> renamed;
  const auto rename_in = [&](Job& job, const std::string& before, const std::string& after) {
    for (std::string& word : job.command) replace_all(word, before, after);
    std::string folder = job.folder.string();
    replace_all(folder, before, after);
    job.folder = folder;
  };
  for (Job& job : plan.jobs) {
    for (const auto& [before, after] : renamed) rename_in(job, before, after);
    if (is_done(out, job)) continue;
    const auto [first, last] = by_content.equal_range(job.content);
    for (auto candidate = first; candidate != last; ++candidate) {
      Job other = job;
      other.id = candidate->second;
      rename_in(other, job.id, other.id);
      // An equal command but for the place of the program: what it read was made by the jobs accepted before it.
      if (!is_done(out, other) ||
          arguments_of(read_record(out, other.id)->command) != arguments_of(shell_line(other.command)))
        continue;
      renamed.emplace_back(job.id, other.id);
      other.of_other_code = true;
      job = std::move(other);
      break;
    }
  }
  std::vector<std::string> names;
  for (const auto& [before, after] : renamed) names.push_back(after);
  if (!names.empty()) log::info("results of other code are kept: {}", joined(names));
}

std::string utc_now() {
  const std::time_t now = std::time(nullptr);
  char stamp[32];
  std::strftime(stamp, sizeof stamp, "%Y-%m-%dT%H:%M:%SZ", std::gmtime(&now));
  return stamp;
}

RunOutcome run_jobs(const fs::path& out, const Plan& plan, const RunOptions& options) {
  // Array tasks of a cluster share the folder, each with a job of its own.
  std::optional<FileLock> lock;
  if (options.only.empty()) lock = FileLock::try_lock(run_lock_file(out), FileLock::Kind::kExclusive);
  if (options.together && options.only.empty())
    throw InputError("", "--together", "goes with --only: it is for the tasks of a cluster, each with one job");
  if (options.only.empty() && !lock)
    throw InputError(out.string(), "", "another anigen-experiment is running jobs here");
  return JobRunner(out, plan, options).run();
}

std::vector<Leftover> find_leftovers(const fs::path& out, const Plan& plan) {
  std::set<std::string> planned, found;
  for (const Job& job : plan.jobs) planned.insert(job.id);
  for (const char* part : {"jobs", "records"}) {
    std::error_code error;
    if (!fs::is_directory(out / part, error)) continue;
    for (const auto& entry : fs::directory_iterator(out / part)) {
      const std::string name = entry.is_directory() ? entry.path().filename() : entry.path().stem();
      // Only what this program has named is ever removed.
      if (is_job_id(name) && planned.count(name) == 0) found.insert(name);
    }
  }
  std::vector<Leftover> leftovers;
  for (const std::string& id : found) leftovers.push_back({id, folder_size(out / "jobs" / id)});
  return leftovers;
}

void remove_leftovers(const fs::path& out, const std::vector<Leftover>& leftovers) {
  for (const Leftover& leftover : leftovers) {
    for (const fs::path& path : {out / "jobs" / leftover.id, record_file(out, leftover.id), log_file(out, leftover.id),
                                 worker_logs(out, leftover.id), job_lock_file(out, leftover.id)}) {
      std::error_code error;
      fs::remove_all(path, error);
      if (error) throw Error(path.string() + ": cannot be removed: " + error.message());
    }
  }
}

}  // namespace anigen::experiment
