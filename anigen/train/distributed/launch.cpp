#include "anigen/train/distributed/launch.h"

#include <unistd.h>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <optional>
#include <sstream>
#include <thread>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/private_folder.h"
#include "anigen/core/process.h"

extern char** environ;  // NOLINT(readability-redundant-declaration): POSIX leaves it to the program

namespace anigen::train {

namespace {

constexpr int kMostRanks = 1 << 16, kMostPort = 65535;
constexpr int kUsualPort = 29500;   // of torchrun
constexpr std::size_t kShown = 80;  // characters of a hostile value that a message repeats

std::optional<std::string> text_of(const Variables& variables, const char* name) {
  const char* value = variables(name);
  if (value == nullptr || *value == '\0') return std::nullopt;
  return std::string(value);
}

int number(const std::string& name, const std::string& value, int least, int most) {
  const bool digits = value.size() <= 9 && !value.empty() && value.find_first_not_of("0123456789") == std::string::npos;
  const int found = digits ? std::stoi(value) : -1;
  if (found < least || found > most) {
    throw InputError(name, value.substr(0, kShown),
                     "expected a whole number from " + std::to_string(least) + " to " + std::to_string(most));
  }
  return found;
}

int required(const Variables& variables, const char* name, const std::string& beside, int least, int most) {
  const std::optional<std::string> value = text_of(variables, name);
  if (!value) throw InputError(name, "", "is not set although " + beside + " is; start all ranks by one launcher");
  return number(name, *value, least, most);
}

int optional_number(const Variables& variables, const char* name, int fallback, int least, int most) {
  const std::optional<std::string> value = text_of(variables, name);
  return value ? number(name, *value, least, most) : fallback;
}

// The names that one launcher has for the same things.
struct Names {
  const char *launcher, *rank, *size, *local_rank, *local_size;
};
constexpr Names kTorchrun{"torchrun", "RANK", "WORLD_SIZE", "LOCAL_RANK", "LOCAL_WORLD_SIZE"};
constexpr Names kOpenMpi{"Open MPI", "OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_LOCAL_RANK",
                         "OMPI_COMM_WORLD_LOCAL_SIZE"};
// SLURM_NTASKS also stands in a batch script, which is one process; the number of tasks of a step only in its tasks.
constexpr Names kSlurm{"SLURM", "SLURM_PROCID", "SLURM_STEP_NUM_TASKS", "SLURM_LOCALID", "SLURM_STEP_TASKS_PER_NODE"};
constexpr Names kOldSlurm{"SLURM", "SLURM_PROCID", "SLURM_NTASKS", "SLURM_LOCALID", "SLURM_TASKS_PER_NODE"};

std::optional<Names> launcher_of(const Variables& variables) {
  const auto has = [&](const char* name) { return text_of(variables, name).has_value(); };
  if (has(kTorchrun.rank) || has(kTorchrun.size)) return kTorchrun;
  if (has(kOpenMpi.rank) || has(kOpenMpi.size)) return kOpenMpi;
  if (has(kSlurm.size)) return kSlurm;
  if (has("SLURM_STEP_ID") && has(kSlurm.rank)) return kOldSlurm;
  return std::nullopt;
}

int local_size(const Variables& variables, const Names& names) {
  const std::optional<std::string> tasks = text_of(variables, names.local_size);
  if (std::string(names.launcher) != kSlurm.launcher || !tasks)
    return optional_number(variables, names.local_size, 1, 1, kMostRanks);
  return tasks_of_node(*tasks, optional_number(variables, "SLURM_NODEID", 0, 0, kMostRanks), names.local_size);
}

Rendezvous parse_rendezvous(const std::string& name, const std::string& url) {
  Rendezvous found;
  if (url.rfind("file://", 0) == 0 && url.size() > 7) {
    found.file = url.substr(7);
    if (found.file.front() == '/') return found;
  }
  if (url.rfind("tcp://", 0) == 0) {
    const std::size_t colon = url.rfind(':');
    found.host = url.substr(6, colon > 6 ? colon - 6 : 0);
    if (!found.host.empty() && found.host.find_first_of("/ ") == std::string::npos) {
      found.port = number(name, url.substr(colon + 1), 1, kMostPort);
      return found;
    }
  }
  throw InputError(name, url.substr(0, kShown), "expected tcp://HOST:PORT or file:///PATH");
}

// A port that two jobs on one machine are unlikely to share.
int slurm_port(const Variables& variables) {
  constexpr int kFirst = 20000, kPorts = 10000;
  const std::optional<std::string> job = text_of(variables, "SLURM_JOB_ID");
  return job ? kFirst + number("SLURM_JOB_ID", *job, 0, 999'999'999) % kPorts : kUsualPort;
}

Rendezvous rendezvous_of(const Variables& variables, const LaunchEnvironment& ranks) {
  Rendezvous found;
  const std::optional<std::string> host = text_of(variables, "MASTER_ADDR");
  const int usual = ranks.launcher == kSlurm.launcher ? slurm_port(variables) : kUsualPort;
  found.port = optional_number(variables, "MASTER_PORT", usual, 1, kMostPort);
  if (host) {
    found.host = *host;
  } else if (ranks.launcher == kSlurm.launcher) {
    const char* name = text_of(variables, "SLURM_STEP_NODELIST") ? "SLURM_STEP_NODELIST" : "SLURM_JOB_NODELIST";
    found.host = first_host(text_of(variables, name).value_or(""), name);
  } else if (ranks.local_size == ranks.size) {
    found.host = "127.0.0.1";
  } else {
    throw InputError("MASTER_ADDR", "",
                     "is not set, so the ranks cannot find each other; set it to the host of rank 0, or give "
                     "--rendezvous tcp://HOST:PORT or file:///PATH");
  }
  found.served = text_of(variables, "TORCHELASTIC_USE_AGENT_STORE").value_or("") == "True";
  return found;
}

using Clock = std::chrono::steady_clock;

constexpr int kFailed = 1, kBadInput = 2, kInterrupted = 130;
constexpr auto kBetweenWaits = std::chrono::milliseconds(20);

// A rank, told by its variables which one it is. It dies with this process.
ChildProcess start(const std::vector<std::string>& words, int rank, int ranks, const std::string& rendezvous) {
  ChildProgram program;
  program.words = words;
  program.file = "/proc/self/exe";
  program.environment = {"RANK=" + std::to_string(rank), "WORLD_SIZE=" + std::to_string(ranks),
                         "LOCAL_RANK=" + std::to_string(rank), "LOCAL_WORLD_SIZE=" + std::to_string(ranks),
                         "ANIGEN_RENDEZVOUS=file://" + rendezvous};
  return ChildProcess(program);
}

class Processes {
 public:
  Processes(const LocalRanks& local, const std::vector<std::string>& words, const std::string& rendezvous)
      : local_(local) {
    running_.reserve(static_cast<std::size_t>(local.ranks));
    for (int rank = 0; rank < local.ranks; ++rank) running_.push_back(start(words, rank, local.ranks, rendezvous));
  }
  ~Processes() { tell(SIGKILL); }
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
    ChildProcess& child = running_[static_cast<std::size_t>(rank)];
    const auto end = child.poll();
    if (!end) return false;
    if (end->status < 0) log::error("rank {} was ended by signal {}", rank, -end->status);
    const int code = end->status < 0 ? kFailed : end->status;
    if (first_failure_ == 0 || code == kBadInput) first_failure_ = code;
    return true;
  }
  void tell(int signal) {
    for (const ChildProcess& child : running_) child.send(signal);
  }

  const LocalRanks& local_;
  std::vector<ChildProcess> running_;
  int first_failure_ = 0;
};

}  // namespace

std::string Rendezvous::text() const {
  return !file.empty() ? "file://" + file : "tcp://" + host + ":" + std::to_string(port);
}

std::string first_host(const std::string& list, const std::string& variable) {
  const InputError malformed(variable, list.substr(0, kShown), "expected a list of hosts such as gpu[003-007],login1");
  const std::size_t end = list.find_first_of("[,");
  std::string host = list.substr(0, end);
  if (end != std::string::npos && list[end] == '[') {
    const std::size_t stop = list.find_first_of("-,]", end + 1);
    if (stop == std::string::npos || list.find(']', end) == std::string::npos) throw malformed;
    const std::string digits = list.substr(end + 1, stop - end - 1);
    if (digits.empty() || digits.find_first_not_of("0123456789") != std::string::npos) throw malformed;
    const std::size_t after = list.find(']', end) + 1;  // "rack[1-2]node" has a name behind the number, too
    host += digits + list.substr(after, list.find_first_of("[,", after) - after);
  }
  constexpr const char* kOfHosts = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-_";
  if (host.empty() || host.find_first_not_of(kOfHosts) != std::string::npos) throw malformed;
  return host;
}

int tasks_of_node(const std::string& list, int node, const std::string& variable) {
  const auto part = [&](const std::string& digits) { return number(variable, digits, 1, kMostRanks); };
  int nodes = 0;
  std::istringstream entries(list);
  for (std::string entry; std::getline(entries, entry, ',');) {
    const std::size_t times = entry.find("(x");
    const bool repeated = times != std::string::npos && entry.back() == ')';
    const int tasks = part(entry.substr(0, repeated ? times : std::string::npos));
    nodes += repeated ? part(entry.substr(times + 2, entry.size() - times - 3)) : 1;
    if (node < nodes) return tasks;
  }
  throw InputError(variable, list.substr(0, kShown), "says nothing of node " + std::to_string(node));
}

LaunchEnvironment read_launch_environment(const Variables& variables, const std::string& rendezvous) {
  LaunchEnvironment found;
  const std::optional<Names> names = launcher_of(variables);
  if (!names) {
    if (!rendezvous.empty()) parse_rendezvous("--rendezvous", rendezvous);
    return found;
  }
  found.launcher = names->launcher;
  found.size = required(variables, names->size, names->rank, 1, kMostRanks);
  found.rank = required(variables, names->rank, names->size, 0, kMostRanks - 1);
  if (found.rank >= found.size) {
    throw InputError(names->rank, std::to_string(found.rank),
                     "must be less than " + std::string(names->size) + ", which is " + std::to_string(found.size));
  }
  found.local_rank = optional_number(variables, names->local_rank, 0, 0, kMostRanks - 1);
  found.local_size = local_size(variables, *names);
  if (found.local_size > found.size) {
    throw InputError(names->local_size, std::to_string(found.local_size),
                     "is more than " + std::string(names->size) + ", which is " + std::to_string(found.size));
  }
  if (found.size == 1) return found;
  const std::optional<std::string> variable = text_of(variables, "ANIGEN_RENDEZVOUS");
  if (!rendezvous.empty()) {
    found.rendezvous = parse_rendezvous("--rendezvous", rendezvous);
  } else if (variable) {
    found.rendezvous = parse_rendezvous("ANIGEN_RENDEZVOUS", *variable);
  } else {
    found.rendezvous = rendezvous_of(variables, found);
  }
  for (const char* name : {"TORCHELASTIC_RESTART_COUNT", "SLURM_RESTART_COUNT"})
    found.rendezvous.attempt += "/" + text_of(variables, name).value_or("0").substr(0, kShown);
  return found;
}

LaunchEnvironment read_launch_environment(const std::string& rendezvous) {
  return read_launch_environment([](const char* name) { return static_cast<const char*>(std::getenv(name)); },
                                 rendezvous);
}

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

std::shared_ptr<Communicator> join_ranks(const LaunchEnvironment& environment, const RankOptions& options) {
  if (environment.size == 1) return std::make_shared<SingleProcess>();
  if (options.sent != torch::kFloat32 && options.sent != torch::kBFloat16)
    throw InputError("--communication", torch::toString(options.sent), "expected fp32 or bf16");
  if (std::shared_ptr<Communicator> ranks = make_c10d(environment, options)) return ranks;
  throw NotSupportedError("", environment.launcher,
                          "training by several processes; this build found no Gloo (LibTorch with c10d, libgloo-dev)");
}

}  // namespace anigen::train
