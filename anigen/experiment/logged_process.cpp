#include "anigen/experiment/logged_process.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <utility>

#include "anigen/core/error.h"

namespace anigen::experiment {

LoggedProcess::LoggedProcess(const std::vector<std::string>& command, const std::filesystem::path& log) {
  std::filesystem::create_directories(log.parent_path());
  const int file = open(log.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  if (file < 0) throw Error(log.string() + ": cannot be written: " + std::strerror(errno));
  // Everything that allocates happens before the fork.
  std::vector<char*> arguments;
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  const pid_t parent = getpid();
  id_ = fork();
  if (id_ == 0) {
    // A group of its own: Ctrl-C at the terminal reaches us alone, and we pass it on once.
    setpgid(0, 0);
    prctl(PR_SET_PDEATHSIG, SIGTERM);
    if (getppid() != parent) _exit(127);
    const int nothing = open("/dev/null", O_RDONLY | O_CLOEXEC);
    if (nothing < 0 || dup2(nothing, 0) < 0 || dup2(file, 1) < 0 || dup2(file, 2) < 0) _exit(127);
    execv(arguments[0], arguments.data());
    const char text[] = "cannot be run\n";
    (void)!write(2, text, sizeof text - 1);
    _exit(127);
  }
  const int problem = errno;
  close(file);
  if (id_ < 0) throw Error(command.front() + ": cannot be started: " + std::strerror(problem));
}

LoggedProcess::LoggedProcess(LoggedProcess&& other) noexcept
    : id_(std::exchange(other.id_, -1)), asked_(other.asked_) {}

LoggedProcess::~LoggedProcess() {
  if (id_ < 0) return;
  ask_to_stop();
  while (waitpid(id_, nullptr, 0) < 0 && errno == EINTR) {
  }
}

std::optional<LoggedProcess::End> LoggedProcess::poll() {
  int status = 0;
  rusage used{};
  const pid_t ended = wait4(id_, &status, WNOHANG, &used);
  if (ended == 0 || (ended < 0 && errno == EINTR)) return std::nullopt;
  if (ended < 0) throw Error(std::string("waiting for a program: ") + std::strerror(errno));
  id_ = -1;
  constexpr std::uint64_t kKilobyte = 1024;  // ru_maxrss counts these on Linux
  return End{WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status),
             static_cast<std::uint64_t>(used.ru_maxrss) * kKilobyte};
}

void LoggedProcess::ask_to_stop() {
  if (id_ < 0 || std::exchange(asked_, true)) return;
  kill(id_, SIGTERM);
}

std::string last_line(const std::filesystem::path& log, std::size_t most) {
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

}  // namespace anigen::experiment
