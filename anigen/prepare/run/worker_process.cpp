#include "anigen/prepare/run/worker_process.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <system_error>

#include "anigen/core/error.h"

namespace anigen::prepare {
namespace {

/// Far above any message; a worker that sends more without a line break has lost its way.
constexpr std::size_t kLongestLine = std::size_t{64} << 20;

[[noreturn]] void refuse(const char* what) { throw Error(std::string("cannot ") + what + ": " + std::strerror(errno)); }

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
  int take(int which) {
    const int end = ends[which];
    ends[which] = -1;
    return end;
  }
};

std::uint64_t resident_pages(const std::string& folder) {
  std::ifstream file(folder + "/statm");
  std::uint64_t total = 0, resident = 0;
  return file >> total >> resident ? resident : 0;
}

}  // namespace

WorkerProcess::WorkerProcess(const std::vector<std::string>& command) {
  std::vector<char*> arguments;
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  // Writing to a worker that died must be an error code, not a signal that ends us.
  ::signal(SIGPIPE, SIG_IGN);
  Pipe to_worker, from_worker;
  const pid_t parent = ::getpid();
  id_ = ::fork();
  if (id_ < 0) refuse("start a process");
  if (id_ == 0) {
    // Between fork and exec only calls that are safe after a fork of a program with threads.
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    if (::getppid() != parent) ::_exit(127);
    ::dup2(to_worker.ends[0], STDIN_FILENO);
    ::dup2(from_worker.ends[1], STDOUT_FILENO);
    // Ctrl-C reaches the whole group; what happens to workers is for the parent to decide.
    ::signal(SIGINT, SIG_IGN);
    ::signal(SIGTERM, SIG_DFL);
    ::signal(SIGPIPE, SIG_DFL);
    ::execv(arguments[0], arguments.data());
    ::_exit(127);
  }
  input_ = to_worker.take(1);
  output_ = from_worker.take(0);
  ::fcntl(output_, F_SETFL, ::fcntl(output_, F_GETFL) | O_NONBLOCK);
}

WorkerProcess::~WorkerProcess() {
  if (id_ > 0) {
    kill();
    wait();
  }
  if (input_ >= 0) ::close(input_);
  if (output_ >= 0) ::close(output_);
}

bool WorkerProcess::send(const std::string& line) {
  const std::string text = line + "\n";
  std::size_t sent = 0;
  while (sent < text.size()) {
    const ssize_t n = ::write(input_, text.data() + sent, text.size() - sent);
    if (n >= 0) {
      sent += static_cast<std::size_t>(n);
    } else if (errno != EINTR) {
      return false;
    }
  }
  return true;
}

std::vector<std::string> WorkerProcess::receive(bool& ended) {
  char buffer[65536];
  for (;;) {
    const ssize_t n = ::read(output_, buffer, sizeof buffer);
    if (n > 0) {
      unread_.append(buffer, static_cast<std::size_t>(n));
      if (unread_.size() > kLongestLine) kill();
    } else if (n == 0) {
      ended = true;
      break;
    } else if (errno != EINTR) {
      ended = errno != EAGAIN && errno != EWOULDBLOCK;
      break;
    }
  }
  std::vector<std::string> lines;
  std::size_t begin = 0;
  for (std::size_t end; (end = unread_.find('\n', begin)) != std::string::npos; begin = end + 1) {
    lines.push_back(unread_.substr(begin, end - begin));
  }
  unread_.erase(0, begin);
  return lines;
}

std::uint64_t WorkerProcess::resident_bytes() const {
  const std::string folder = "/proc/" + std::to_string(id_);
  const std::uint64_t own = resident_pages(folder);
  std::uint64_t pages = own;
  std::error_code error;
  for (std::filesystem::directory_iterator thread(folder + "/task", error), end; !error && thread != end;
       thread.increment(error)) {
    std::ifstream children(thread->path() / "children");
    // A copy shares the worker's pages until one of them writes: those count once.
    for (std::string child; children >> child;) pages += std::max(own, resident_pages("/proc/" + child)) - own;
  }
  return pages * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
}

void WorkerProcess::kill() {
  if (id_ > 0) ::kill(id_, SIGKILL);
}

std::string WorkerProcess::wait() {
  int status = 0;
  for (int round = 0;; ++round) {
    // One that closed its output without ending gets a second and is then made to end.
    const pid_t ended = ::waitpid(id_, &status, round < 100 ? WNOHANG : 0);
    if (ended == id_) break;
    if (ended < 0 && errno != EINTR) {
      id_ = -1;
      return "was lost";
    }
    ::usleep(10000);
    if (round == 99) kill();
  }
  id_ = -1;
  if (WIFSIGNALED(status)) {
    const int signal = WTERMSIG(status);
    return "was ended by signal " + std::to_string(signal) + " (" + ::strsignal(signal) + ")";
  }
  return "ended with status " + std::to_string(WEXITSTATUS(status));
}

}  // namespace anigen::prepare
