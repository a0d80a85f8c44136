#include "anigen/core/process.h"

#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <exception>
#include <fstream>
#include <sstream>
#include <system_error>
#include <thread>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/job.h"
#include "anigen/core/random.h"
#include "anigen/core/worker_process.h"

namespace anigen {

namespace {

/// Fields of /proc/<id>/stat behind the program's name, which may hold blanks and brackets itself.
struct ProcessState {
  char state = 0;                         ///< 0: there is no such process, or nobody says
  std::uint64_t worked = 0, started = 0;  ///< in clock ticks: processor time, and the start since boot
};

ProcessState state_of(std::int64_t id) {
  constexpr int kFieldsBeforeTimes = 10;  // between the state, field 3, and processor times, fields 14 and 15
  constexpr int kFieldsBehindTimes = 6;   // between these and the time of the start, field 22
  std::ifstream file("/proc/" + std::to_string(id) + "/stat");
  std::string line;
  if (!std::getline(file, line)) return {};
  const std::size_t name_end = line.rfind(')');
  if (name_end == std::string::npos) return {};
  std::istringstream fields(line.substr(name_end + 1));
  ProcessState found;
  std::string skipped;
  std::uint64_t of_user = 0, of_system = 0;
  fields >> found.state;
  for (int i = 0; i < kFieldsBeforeTimes; ++i) fields >> skipped;
  fields >> of_user >> of_system;
  for (int i = 0; i < kFieldsBehindTimes; ++i) fields >> skipped;
  fields >> found.started;
  found.worked = of_user + of_system;
  return fields ? found : ProcessState{};
}

/// @param kind of namespace, as in /proc/self/ns
std::string read_space(const char* kind) {
  std::ifstream file("/proc/sys/kernel/random/boot_id");
  std::string boot;
  std::getline(file, boot);
  char name[64];
  const ssize_t size = ::readlink((std::string("/proc/self/ns/") + kind).c_str(), name, sizeof name);
  return boot.empty() || size <= 0 ? "" : boot + "/" + std::string(name, static_cast<std::size_t>(size));
}

std::string read_host() {
  char name[256] = {};
  return ::gethostname(name, sizeof name - 1) == 0 ? name : "unknown";
}

namespace fs = std::filesystem;
using Kind = FileLock::Kind;

FileLock pass_gate(const fs::path& file) { return wait_for_lock(file.string() + "-gate", Kind::kExclusive); }

volatile std::sig_atomic_t requested = 0;

void handle(int signal) {
  requested = 1;
  std::signal(signal, SIG_DFL);
}

constexpr int kWorkThrew = 3;
constexpr int kPollMilliseconds = 20;
/// A copy that sleeps so long without working is taken for one that waits for a lock that nobody gives back.
constexpr double kStuckSeconds = 2.0;
constexpr int kMostCopies = 3;
/// Of time that passes to time the processor works: only work that waits for something reaches it.
constexpr double kPatience = 10.0;

[[noreturn]] void refuse(const char* what) { throw Error(std::string("cannot ") + what + ": " + std::strerror(errno)); }

/// Both ends of a pipe, closed when nobody takes them.
struct Pipe {
  int ends[2] = {-1, -1};
  Pipe() {
    if (::pipe2(ends, O_CLOEXEC) != 0) refuse("make a pipe");
  }
  ~Pipe() {
    for (const int end : ends) {
      if (end >= 0) ::close(end);
    }
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;
  int take(int which) { return std::exchange(ends[which], -1); }
};

std::vector<char*> pointers(const std::vector<std::string>& words) {
  std::vector<char*> result;
  for (const std::string& word : words) result.push_back(const_cast<char*>(word.c_str()));
  result.push_back(nullptr);
  return result;
}

std::uint64_t page_bytes() { return static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE)); }

/// Of address space; 0 when the system does not say.
std::uint64_t bytes_in_use() {
  std::ifstream file("/proc/self/statm");
  std::uint64_t pages = 0;
  return file >> pages ? pages * page_bytes() : 0;
}

void lower_limit(int resource, std::uint64_t value) {
  rlimit limit{};
  if (::getrlimit(static_cast<__rlimit_resource_t>(resource), &limit) != 0) return;
  limit.rlim_cur = std::min<rlim_t>(value, limit.rlim_max);
  ::setrlimit(static_cast<__rlimit_resource_t>(resource), &limit);
}

/// Closes every file of this process but its standard ones and one more, where the system can.
void close_all_but(int kept) {
#ifdef SYS_close_range
  const auto before = static_cast<unsigned>(kept);
  if (before > STDERR_FILENO + 1U) ::syscall(SYS_close_range, STDERR_FILENO + 1U, before - 1, 0U);
  ::syscall(SYS_close_range, std::max(before, STDERR_FILENO + 0U) + 1U, ~0U, 0U);
#else
  static_cast<void>(kept);
#endif
}

/// The copy's side: the length of the result, then the result. It never returns.
[[noreturn]] void work_in_copy(const std::function<std::string()>& work, const ProcessLimits& limits,
                               std::uint64_t memory, int to) {
  for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGXCPU}) ::signal(signal, SIG_DFL);
  ::signal(SIGINT, SIG_IGN);  // a Ctrl-C is for the parent to act on
  lower_limit(RLIMIT_CORE, 0);
  lower_limit(RLIMIT_CPU, static_cast<std::uint64_t>(std::ceil(std::max(1.0, limits.cpu_seconds))));
  if (memory > 0) lower_limit(RLIMIT_AS, memory);
  int status = kWorkThrew;
  try {
    if (limits.sandbox) {
      close_all_but(to);
      enter_sandbox(*limits.sandbox);
    }
    const std::string result = work();
    const std::uint64_t size = result.size();
    char head[sizeof size];
    std::memcpy(head, &size, sizeof size);
    if (write_all(to, {head, sizeof head}) && write_all(to, result)) status = 0;
  } catch (const std::exception&) {
  }
  ::_exit(status);
}

/// Collects the result that the copy sends. A hostile file may have taken the copy over, so the length it announces is
/// bounded: honest work holds its result in memory.
class Receiver {
 public:
  /// @param most bytes of the result
  Receiver(int from, std::uint64_t most) : from_(from), most_(most) {}

  /// Takes what is there. @return false when no more can come, or is wanted
  bool receive() {
    char buffer[65536];
    for (;;) {
      const ssize_t n = ::read(from_, buffer, sizeof buffer);
      if (n > 0)
        bytes_.append(buffer, static_cast<std::size_t>(n));
      else if (n == 0)
        return false;
      else if (errno != EINTR)
        return errno == EAGAIN || errno == EWOULDBLOCK;
      if (is_complete() || is_too_long()) return false;
    }
  }
  bool is_complete() const { return has_length() && length() <= most_ && bytes_.size() - kHead >= length(); }
  bool is_too_long() const { return has_length() && length() > most_; }
  std::size_t received() const { return bytes_.size(); }
  std::string take() {
    bytes_.resize(kHead + length());
    bytes_.erase(0, kHead);
    return std::move(bytes_);
  }

 private:
  static constexpr std::size_t kHead = sizeof(std::uint64_t);

  bool has_length() const { return bytes_.size() >= kHead; }
  std::uint64_t length() const {
    std::uint64_t value = 0;
    std::memcpy(&value, bytes_.data(), kHead);
    return value;
  }

  int from_;
  std::uint64_t most_;
  std::string bytes_;
};

double seconds_after(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// Notices a copy that waits for ever. Locks that other threads held when it was made stay locked in it; those of the C
/// library are mended by fork(), those of other libraries are not.
class StuckWatch {
 public:
  explicit StuckWatch(pid_t id) : id_(id) {}

  /// Call again and again. @param received bytes that have come from it
  bool is_stuck(std::size_t received) {
    if (seconds_after(looked_) < 0.1) return false;
    looked_ = std::chrono::steady_clock::now();
    const ProcessState now = state_of(id_);
    if (now.state != 'S' || now.worked != worked_ || received != received_) moved_ = looked_;
    worked_ = now.worked;
    received_ = received;
    return seconds_after(moved_) > kStuckSeconds;
  }

 private:
  pid_t id_;
  std::chrono::steady_clock::time_point looked_ = std::chrono::steady_clock::now(), moved_ = looked_;
  std::uint64_t worked_ = 0;
  std::size_t received_ = 0;
};

std::string ending(int status, double cpu_seconds) {
  if (status >= 0) return "crashed (status " + std::to_string(status) + ")";
  if (status == -SIGXCPU)
    return "took more than " + std::to_string(static_cast<long>(std::ceil(cpu_seconds))) + " s of processor time";
  if (status == -SIGKILL) return "was ended by the system, which happens when memory runs out";
  return std::string("crashed (") + ::strsignal(-status) + ")";
}

}  // namespace

ProcessIdentity this_process() {
  // Of the machine, and so the same after a fork.
  static const std::string host = read_host(), space = read_space("pid");
  ProcessIdentity process{host, space, ::getpid(), 0};
  process.started = state_of(process.id).started;
  return process;
}

bool certainly_gone(const ProcessIdentity& process) {
  const ProcessIdentity here = this_process();
  if (process.space.empty() || process.space != here.space || here.started == 0) return false;
  const ProcessState found = state_of(process.id);
  return found.state == 0 || found.state == 'Z' || found.state == 'X' || found.started != process.started;
}

std::string network_space() {
  const std::string space = read_space("net");
  return space.empty() ? read_host() : space;
}

std::string process_number() {
  // Kept, since it names every file that is written; asked for anew after a fork.
  thread_local std::int64_t of_process = -1;
  thread_local std::string number;
  if (of_process != ::getpid()) {
    const ProcessIdentity process = this_process();
    of_process = process.id;
    number = std::to_string(stable_hash(to_json(process).dump()));
  }
  return number;
}

Json to_json(const ProcessIdentity& process) {
  return {{"host", process.host}, {"space", process.space}, {"id", process.id}, {"started", process.started}};
}

ProcessIdentity process_identity_from_json(const Json& json) {
  return {json.at("host").get<std::string>(), json.at("space").get<std::string>(), json.at("id").get<std::int64_t>(),
          json.at("started").get<std::uint64_t>()};
}

std::optional<FileLock> FileLock::try_lock(const std::filesystem::path& file, Kind kind) {
  make_folders(file.parent_path());
  const int descriptor = ::open(file.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
  if (descriptor < 0) throw Error(file.string() + ": cannot open: " + std::strerror(errno));
  const int operation = kind == Kind::kShared ? LOCK_SH : LOCK_EX;
  if (::flock(descriptor, operation | LOCK_NB) == 0) return FileLock(descriptor);
  const int reason = errno;
  ::close(descriptor);
  if (reason == EWOULDBLOCK) return std::nullopt;
  if (reason == ENOSYS || reason == EOPNOTSUPP || reason == ENOLCK)
    throw NotSupportedError(file.string(), "", "locks (flock) by the file system of this folder");
  throw Error(file.string() + ": cannot lock: " + std::strerror(reason));
}

FileLock::~FileLock() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

std::filesystem::path dataset_lock_file(const std::filesystem::path& root) { return root / "run" / "lock"; }

std::filesystem::path dataset_prepare_lock_file(const std::filesystem::path& root) {
  return root / "run" / "lock-prepare";
}

FileLock wait_for_lock(const fs::path& file, Kind kind) {
  for (;;) {
    if (std::optional<FileLock> lock = FileLock::try_lock(file, kind)) return std::move(*lock);
    throw_if_interrupted();
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
}

std::optional<FileLock> join_group(const fs::path& file, const std::function<void(bool)>& enter) {
  const FileLock gate = pass_gate(file);
  const bool first = FileLock::try_lock(file, Kind::kExclusive).has_value();
  if (!first && !FileLock::try_lock(file, Kind::kShared)) return std::nullopt;
  enter(first);
  return FileLock::try_lock(file, Kind::kShared);
}

std::optional<FileLock> instead_of_group(const fs::path& file) {
  const FileLock gate = pass_gate(file);
  return FileLock::try_lock(file, Kind::kExclusive);
}

bool while_group_is_empty(const fs::path& file, const std::function<void()>& action) {
  const FileLock gate = pass_gate(file);
  if (!FileLock::try_lock(file, Kind::kExclusive)) return false;
  action();
  return true;
}

void install_interrupt_handler() {
  std::signal(SIGINT, handle);
  std::signal(SIGTERM, handle);
}

bool interrupt_requested() {
  const Job* job = current_job();
  return requested != 0 || (job != nullptr && job->cancelled());
}

void throw_if_interrupted() {
  if (requested != 0) throw Interrupted("interrupted; what was finished is saved");
  if (interrupt_requested()) throw Interrupted("cancelled");
}

ChildProcess::ChildProcess(const ChildProgram& program) : last_signal_(program.last_signal) {
  // Everything that allocates happens before the fork.
  const std::string& file = program.file.empty() ? program.words.front() : program.file;
  const std::vector<char*> arguments = pointers(program.words);
  std::vector<char*> environment = pointers(program.environment);  // of a name twice the first counts
  environment.pop_back();
  for (char** variable = environ; *variable != nullptr; ++variable) environment.push_back(*variable);
  environment.push_back(nullptr);
  std::optional<Pipe> to_it, from_it;
  int log = -1;
  if (program.pipes) {
    to_it.emplace();
    from_it.emplace();
    ::signal(SIGPIPE, SIG_IGN);  // writing to a program that has ended is an error code, not our end
  }
  if (!program.log.empty()) {
    make_folders(program.log.parent_path());
    log = ::open(program.log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
    if (log < 0) throw Error(program.log.string() + ": cannot be written: " + std::strerror(errno));
  }
  const pid_t parent = ::getpid();
  id_ = ::fork();
  if (id_ == 0) {
    if (program.own_group) {
      ::setpgid(0, 0);
    } else {
      ::signal(SIGINT, SIG_IGN);
    }
    ::signal(SIGTERM, SIG_DFL);
    ::signal(SIGPIPE, SIG_DFL);
    ::prctl(PR_SET_PDEATHSIG, program.last_signal);
    if (::getppid() != parent) ::_exit(127);
    const int input = to_it ? to_it->ends[0] : log >= 0 ? ::open("/dev/null", O_RDONLY | O_CLOEXEC) : STDIN_FILENO;
    const int output = from_it ? from_it->ends[1] : log >= 0 ? log : STDOUT_FILENO;
    const int errors = log >= 0 ? log : STDERR_FILENO;
    const auto put = [](int from, int to) { return from == to || ::dup2(from, to) >= 0; };
    if (!put(input, STDIN_FILENO) || !put(output, STDOUT_FILENO) || !put(errors, STDERR_FILENO)) ::_exit(127);
#ifdef SYS_close_range
    ::syscall(SYS_close_range, STDERR_FILENO + 1U, ~0U, 0U);  // libraries open files that exec would leave open
#endif
    ::execve(file.c_str(), arguments.data(), environment.data());
    const char text[] = "cannot be run\n";
    (void)!::write(STDERR_FILENO, text, sizeof text - 1);
    ::_exit(127);
  }
  const int problem = errno;
  if (log >= 0) ::close(log);
  if (id_ < 0) throw Error(program.words.front() + ": cannot be started: " + std::strerror(problem));
  if (!program.pipes) return;
  input_ = to_it->take(1);
  output_ = from_it->take(0);
  ::fcntl(output_, F_SETFL, ::fcntl(output_, F_GETFL) | O_NONBLOCK);
}

ChildProcess::ChildProcess(ChildProcess&& other) noexcept
    : id_(std::exchange(other.id_, -1)),
      input_(std::exchange(other.input_, -1)),
      output_(std::exchange(other.output_, -1)),
      last_signal_(other.last_signal_),
      asked_(other.asked_) {}

ChildProcess::~ChildProcess() {
  // Not when it was asked already, since a second signal would end it at once.
  if (last_signal_ == SIGTERM) {
    ask_to_stop();
  } else {
    send(last_signal_);
  }
  while (id_ > 0 && ::waitpid(id_, nullptr, 0) < 0 && errno == EINTR) {
  }
  for (const int end : {input_, output_}) {
    if (end >= 0) ::close(end);
  }
}

std::optional<ChildProcess::End> ChildProcess::poll() {
  if (id_ < 0) return std::nullopt;
  int status = 0;
  rusage used{};
  const pid_t ended = ::wait4(id_, &status, WNOHANG, &used);
  if (ended == 0 || (ended < 0 && errno == EINTR)) return std::nullopt;
  if (ended < 0) throw Error(std::string("waiting for a program: ") + std::strerror(errno));
  id_ = -1;
  constexpr std::uint64_t kKilobyte = 1024;  // ru_maxrss counts these on Linux
  return End{WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status),
             static_cast<std::uint64_t>(used.ru_maxrss) * kKilobyte};
}

void ChildProcess::send(int signal) const {
  if (id_ > 0) ::kill(id_, signal);
}

void ChildProcess::ask_to_stop() {
  if (!std::exchange(asked_, true)) send(SIGTERM);
}

namespace {

/// @param is_last an earlier copy was stuck too often: this one may sleep as long as there is patience
/// @return nothing for a copy that is stuck
std::optional<GuardedWork> work_guarded(const std::function<std::string()>& work, const ProcessLimits& limits,
                                        bool is_last) {
  const std::uint64_t machine = static_cast<std::uint64_t>(::sysconf(_SC_PHYS_PAGES)) * page_bytes();
  const std::uint64_t used = bytes_in_use(), more = limits.more_memory > 0 ? limits.more_memory : machine;
  const std::uint64_t memory = used > 0 ? used + more : 0;
  Pipe pipe;
  const int* ends = pipe.ends;
  const pid_t parent = ::getpid(), id = ::fork();
  if (id < 0) refuse("start a process");
  if (id == 0) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::getppid() != parent) ::_exit(kWorkThrew);
    ::close(ends[0]);
    work_in_copy(work, limits, memory, ends[1]);
  }
  ::close(pipe.take(1));
  ::fcntl(ends[0], F_SETFL, ::fcntl(ends[0], F_GETFL) | O_NONBLOCK);
  ChildProcess copy(id, SIGKILL);
  Receiver receiver(ends[0], more);
  StuckWatch watch(id);
  const auto start = std::chrono::steady_clock::now();
  GuardedWork outcome;
  std::optional<ChildProcess::End> end;
  for (;;) {
    // Looked at before the pipe is emptied: then nothing can come after it. The pipe's end alone does not tell, since a
    // copy that another thread makes meanwhile keeps it open.
    end = copy.poll();
    const bool more_may_come = receiver.receive();
    if (receiver.is_complete()) {
      outcome.finished = true;
      outcome.result = receiver.take();
      return outcome;
    }
    if (receiver.is_too_long()) {
      outcome.failure = "sent back more than it may hold in memory";
      return outcome;
    }
    if (end) break;
    if (limits.while_waiting) limits.while_waiting();
    if (!is_last && watch.is_stuck(receiver.received())) return std::nullopt;
    if (seconds_after(start) > kPatience * std::max(1.0, limits.cpu_seconds)) {
      outcome.failure = "did not finish within " +
                        std::to_string(static_cast<long>(kPatience * std::max(1.0, limits.cpu_seconds))) + " s";
      return outcome;
    }
    pollfd wanted{ends[0], POLLIN, 0};
    ::poll(&wanted, more_may_come ? 1 : 0, more_may_come ? kPollMilliseconds : 1);
  }
  outcome.failure = ending(end->status, limits.cpu_seconds);
  return outcome;
}

}  // namespace

GuardedWork run_guarded(const std::function<std::string()>& work, const ProcessLimits& limits) {
  for (int copies = 1;; ++copies) {
    if (std::optional<GuardedWork> outcome = work_guarded(work, limits, copies == kMostCopies))
      return std::move(*outcome);
  }
}

}  // namespace anigen
