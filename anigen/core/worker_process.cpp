#include "anigen/core/worker_process.h"

#include <unistd.h>
#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <system_error>

namespace anigen {

namespace {

/// Far above any message; a worker that sends more without a line break has lost its way.
constexpr std::size_t kLongestLine = std::size_t{64} << 20;

std::uint64_t resident_pages(const std::string& folder) {
  std::ifstream file(folder + "/statm");
  std::uint64_t total = 0, resident = 0;
  return file >> total >> resident ? resident : 0;
}

ChildProgram worker_program(const std::vector<std::string>& command, bool own_group) {
  ChildProgram program;
  program.words = command;
  program.pipes = true;
  program.own_group = own_group;
  program.last_signal = SIGKILL;
  return program;
}

}  // namespace

bool write_all(int descriptor, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t n = ::write(descriptor, bytes.data(), bytes.size());
    if (n >= 0) {
      bytes.remove_prefix(static_cast<std::size_t>(n));
    } else if (errno != EINTR) {
      return false;
    }
  }
  return true;
}

WorkerProcess::WorkerProcess(const std::vector<std::string>& command, bool own_group)
    : child_(worker_program(command, own_group)) {}

std::vector<std::string> WorkerProcess::receive(bool& ended) {
  char buffer[65536];
  for (;;) {
    const ssize_t n = ::read(child_.output(), buffer, sizeof buffer);
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
  for (std::size_t end; (end = unread_.find('\n', begin)) != std::string::npos; begin = end + 1)
    lines.push_back(unread_.substr(begin, end - begin));
  unread_.erase(0, begin);
  return lines;
}

std::uint64_t WorkerProcess::resident_bytes() const {
  const std::string folder = "/proc/" + std::to_string(child_.id());
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

std::string WorkerProcess::wait() {
  for (int round = 0;; ++round) {
    if (const auto end = child_.poll()) {
      if (end->status >= 0) return "ended with status " + std::to_string(end->status);
      return "was ended by signal " + std::to_string(-end->status) + " (" + ::strsignal(-end->status) + ")";
    }
    ::usleep(10000);
    if (round == 99) kill();  // closed its output without ending
  }
}

WorkerMessages::WorkerMessages() : descriptor_(::dup(STDOUT_FILENO)) { ::dup2(STDERR_FILENO, STDOUT_FILENO); }

WorkerMessages::~WorkerMessages() { ::close(descriptor_); }

void WorkerMessages::send(const Json& message) const {
  const std::string text = message.dump(-1, ' ', false, Json::error_handler_t::replace) + "\n";
  if (!write_all(descriptor_, text)) std::_Exit(1);  // nobody listens any more
}

}  // namespace anigen
