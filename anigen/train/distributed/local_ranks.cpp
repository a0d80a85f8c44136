#include "anigen/train/distributed/local_ranks.h"

#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <thread>

#include "anigen/core/error.h"
#include "anigen/core/interrupt.h"
#include "anigen/core/log.h"

extern char** environ;

namespace anigen::train {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kFailed = 1, kBadInput = 2, kInterrupted = 130;
constexpr auto kBetweenWaits = std::chrono::milliseconds(20);

std::vector<char*> pointers(const std::vector<std::string>& words) {
  std::vector<char*> result;
  for (const std::string& word : words) result.push_back(const_cast<char*>(word.c_str()));
  result.push_back(nullptr);
  return result;
}

// This process's variables, and those that tell a rank who it is before them: the first of a name counts.
std::vector<std::string> variables_of(int rank, int ranks, const std::string& rendezvous) {
  std::vector<std::string> own{"RANK=" + std::to_string(rank), "WORLD_SIZE=" + std::to_string(ranks),
                               "LOCAL_RANK=" + std::to_string(rank), "LOCAL_WORLD_SIZE=" + std::to_string(ranks),
                               "ANIGEN_RENDEZVOUS=file://" + rendezvous};
  for (char** variable = environ; *variable != nullptr; ++variable) own.emplace_back(*variable);
  return own;
}

pid_t start(const std::vector<std::string>& words, const std::vector<std::string>& variables) {
  const std::vector<char*> arguments = pointers(words), environment = pointers(variables);
  const pid_t parent = ::getpid();
  const pid_t child = ::fork();
  if (child < 0) throw Error(std::string("cannot start a process: ") + std::strerror(errno));
  if (child > 0) return child;
  // A group of its own: Ctrl-C in a terminal reaches this process alone, which hands it on once; the second one would
  // end a rank before it has saved. Ranks do not outlive this process.
  ::setpgid(0, 0);
  ::prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (::getppid() != parent) std::_Exit(kFailed);
  ::execve("/proc/self/exe", arguments.data(), environment.data());
  std::_Exit(127);
}

// A new folder that only this user can enter, gone with what is in it at the end.
class PrivateFolder {
 public:
  PrivateFolder() : path_((std::filesystem::temp_directory_path() / "anigen-ranks-XXXXXX").string()) {
    if (::mkdtemp(path_.data()) == nullptr) {
      throw Error(path_ + ": cannot create a temporary folder: " + std::strerror(errno));
    }
  }
  ~PrivateFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  PrivateFolder(const PrivateFolder&) = delete;
  PrivateFolder& operator=(const PrivateFolder&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

class Processes {
 public:
  Processes(const LocalRanks& local, const std::vector<std::string>& words, const std::string& rendezvous)
      : local_(local) {
    for (int rank = 0; rank < local.ranks; ++rank) {
      running_.push_back(start(words, variables_of(rank, local.ranks, rendezvous)));
    }
  }
  ~Processes() {
    tell(SIGKILL);
    for (const pid_t child : running_) {
      if (child != 0) ::waitpid(child, nullptr, 0);
    }
  }
  Processes(const Processes&) = delete;
  Processes& operator=(const Processes&) = delete;

  int wait() {
    int left = local_.ranks;
    bool handed_on = false;
    Clock::time_point failed_at;
    while (left > 0) {
      for (int rank = 0; rank < local_.ranks; ++rank) left -= ended(rank) ? 1 : 0;
      if (interrupt_requested() && !handed_on) {
        tell(SIGINT);
        handed_on = true;
      }
      if (first_failure_ == 0) {
        failed_at = Clock::now();
      } else if (Clock::now() - failed_at > std::chrono::duration<double>(2.0 * local_.timeout)) {
        tell(SIGKILL);
      }
      if (left > 0) std::this_thread::sleep_for(kBetweenWaits);
    }
    return first_failure_;
  }

 private:
  bool ended(int rank) {
    pid_t& child = running_[static_cast<std::size_t>(rank)];
    int status = 0;
    if (child == 0 || ::waitpid(child, &status, WNOHANG) != child) return false;
    child = 0;
    if (WIFSIGNALED(status)) log::error("rank {} was ended by signal {}", rank, WTERMSIG(status));
    const int code = WIFEXITED(status) ? WEXITSTATUS(status) : kFailed;
    if (first_failure_ == 0 || code == kBadInput) first_failure_ = code;
    return true;
  }
  void tell(int signal) {
    for (const pid_t child : running_) {
      if (child != 0) ::kill(child, signal);
    }
  }

  const LocalRanks& local_;
  std::vector<pid_t> running_;  // 0: has ended
  int first_failure_ = 0;
};

}  // namespace

int run_local_ranks(const LocalRanks& local, const std::vector<std::string>& words) {
  const PrivateFolder folder;
  for (int attempt = 0;; ++attempt) {
    const int status = Processes(local, words, folder.path() + "/attempt" + std::to_string(attempt)).wait();
    const bool again = status != 0 && status != kBadInput && status != kInterrupted && !interrupt_requested();
    if (!again || attempt >= local.restarts) return status;
    log::warn("starting all {} ranks again from the last checkpoint ({} of {})", local.ranks, attempt + 1,
              local.restarts);
  }
}

}  // namespace anigen::train
