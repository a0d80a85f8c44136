#include "anigen/core/parallel.h"

#include <sched.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <memory>
#include <mutex>
#include <set>
#include <sstream>
#include <string>
#include <system_error>
#include <thread>
#include <vector>

#include "anigen/core/job.h"

// TBB's library is built without the thread sanitizer, and lean builds do without it.
#if defined(ANIGEN_LEAN) || defined(__SANITIZE_THREAD__)
#define ANIGEN_OWN_THREADS
#else
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>
#endif

namespace anigen {

namespace {

int cores_to_use() { return default_thread_count(find_cores()); }

int& count_setting() {
  static int count = cores_to_use();
  return count;
}

namespace fs = std::filesystem;

constexpr double kNoQuota = std::numeric_limits<double>::infinity();

std::string first_line(const fs::path& file) {
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  return line;
}

/// Numbers of a file's first line; not a number, such as "max", counts as negative.
double share(const std::string& quota, const std::string& period) {
  char* end = nullptr;
  const double time = std::strtod(quota.c_str(), &end);
  const bool is_number = end != quota.c_str();
  const double of = std::strtod(period.c_str(), nullptr);
  return is_number && time > 0.0 && of > 0.0 ? time / of : kNoQuota;
}

double quota_of(const fs::path& group) {
  std::istringstream together(first_line(group / "cpu.max"));  // version 2
  std::string quota, period;
  if (together >> quota >> period) return share(quota, period);
  return share(first_line(group / "cpu.cfs_quota_us"), first_line(group / "cpu.cfs_period_us"));  // version 1
}

/// Every group above the process' own limits it, too. Inside a container the path that /proc names may lie outside
/// what is mounted; the mount's own top is then the container's group.
double tightest_quota(const fs::path& mount, const std::string& path) {
  double tightest = quota_of(mount);
  fs::path group = mount;
  for (const fs::path& part : fs::path(path).relative_path()) {
    group /= part;
    tightest = std::min(tightest, quota_of(group));
  }
  return tightest;
}

double group_quota(const fs::path& root) {
  std::ifstream groups(root / "proc/self/cgroup");
  double tightest = kNoQuota;
  // "0::/path" for version 2, "4:cpu,cpuacct:/path" for version 1.
  for (std::string line; std::getline(groups, line);) {
    const std::size_t first = line.find(':'), second = line.find(':', first + 1);
    if (first == std::string::npos || second == std::string::npos) continue;
    const std::string controllers = "," + line.substr(first + 1, second - first - 1) + ",";
    const std::string path = line.substr(second + 1);
    if (controllers == ",,") {
      tightest = std::min(tightest, tightest_quota(root / "sys/fs/cgroup", path));
      tightest = std::min(tightest, tightest_quota(root / "sys/fs/cgroup/unified", path));
    } else if (controllers.find(",cpu,") != std::string::npos) {
      tightest = std::min(tightest, tightest_quota(root / "sys/fs/cgroup/cpu", path));
      tightest = std::min(tightest, tightest_quota(root / "sys/fs/cgroup/cpu,cpuacct", path));
    }
  }
  return tightest;
}

/// A positive number in the environment, otherwise 0.
int number_in(const char* variable) {
  const char* text = std::getenv(variable);
  if (text == nullptr) return 0;
  const long number = std::strtol(text, nullptr, 10);  // of a list, "4,2", the outermost
  return number > 0 && number < 1 << 16 ? static_cast<int>(number) : 0;
}

}  // namespace

namespace {

#ifdef ANIGEN_OWN_THREADS
void limit_threads(int) {}

/// A loop on threads of its own, the calling one among them; loops inside it run on the thread that comes to them.
template <typename Body>
void loop(std::size_t n, const Body& body) {
  static thread_local bool is_inside = false;
  if (is_inside) {
    for (std::size_t i = 0; i < n; ++i) body(i);
    return;
  }
  std::atomic<std::size_t> next{0};
  std::mutex mutex;
  std::exception_ptr problem;
  const auto work = [&] {
    is_inside = true;
    for (std::size_t i = next++; i < n; i = next++) {
      try {
        body(i);
      } catch (...) {
        const std::lock_guard<std::mutex> lock(mutex);
        if (!problem) problem = std::current_exception();
        next = n;
      }
    }
    is_inside = false;
  };
  const std::size_t count = std::min(n, static_cast<std::size_t>(thread_count()));
  std::vector<std::thread> threads;
  // A node may grant no further thread: those that there are do the work.
  try {
    for (std::size_t t = 1; t < count; ++t) threads.emplace_back(work);
  } catch (const std::system_error&) {
  }
  work();
  for (std::thread& thread : threads) thread.join();
  if (problem) std::rethrow_exception(problem);
}
#else
void limit_threads(int count) {
  static std::unique_ptr<tbb::global_control> control;
  control = std::make_unique<tbb::global_control>(tbb::global_control::max_allowed_parallelism,
                                                  static_cast<std::size_t>(count));
}

template <typename Body>
void loop(std::size_t n, const Body& body) {
  tbb::parallel_for(std::size_t{0}, n, body);
}
#endif

}  // namespace

void set_thread_count(int threads) {
  count_setting() = threads > 0 ? threads : cores_to_use();
  limit_threads(count_setting());
}

int thread_count() { return count_setting(); }

void share_processors() {
  // GNU's OpenMP spins 300,000 times before it sleeps, several milliseconds in which a thread whose partner has lost
  // its processor keeps another program from that partner's next turn. This bridges the gaps between operators alone.
  constexpr const char* kSpins = "300";
  if (std::getenv("OMP_WAIT_POLICY") == nullptr) ::setenv("GOMP_SPINCOUNT", kSpins, 0);
  // A short time slice lets a thread that wakes run before one with a longer slice (EEVDF, Linux 6.12 and newer); its
  // part of the processor stays the same. Each operator's threads would otherwise wait a slice of their neighbour's.
  struct {
    std::uint32_t size = 48, policy = SCHED_OTHER;
    std::uint64_t flags = 0;
    std::int32_t nice = 0;
    std::uint32_t priority = 0;
    std::uint64_t slice = 0, deadline = 0, period = 0;
  } settings;
  constexpr std::uint64_t kSlice = 100'000;  // ns, the shortest
  if (::syscall(SYS_sched_getattr, 0, &settings, sizeof settings, 0) != 0 || settings.policy != SCHED_OTHER) return;
  settings.slice = kSlice;
  ::syscall(SYS_sched_setattr, 0, &settings, 0);  // an older kernel ignores it
}

void parallel_for(std::size_t n, const std::function<void(std::size_t)>& body) {
  if (thread_count() == 1 || n < 2) {
    for (std::size_t i = 0; i < n; ++i) body(i);
    return;
  }
  Job* job = current_job();
  loop(n, [&](std::size_t i) {
    const JobScope scope(job);
    body(i);
  });
}

Cores find_cores(const fs::path& root) {
  Cores cores;
  cores.quota = group_quota(root);
  if (const int on_node = number_in("SLURM_CPUS_ON_NODE")) cores.quota = std::min(cores.quota, double(on_node));
  cores.asked = number_in("OMP_NUM_THREADS");
  cores.per_task = number_in("SLURM_CPUS_PER_TASK");
  cpu_set_t set;
  if (::sched_getaffinity(0, sizeof set, &set) != 0) {  // more processors than a cpu_set_t holds
    cores.allowed = cores.physical = cores.launcher =
        std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
    return cores;
  }
  cores.launcher = cores.allowed = std::max(1, CPU_COUNT(&set));
  cpu_set_t of_parent;
  if (::sched_getaffinity(::getppid(), sizeof of_parent, &of_parent) == 0)
    cores.launcher = std::max(1, CPU_COUNT(&of_parent));
  std::set<std::string> siblings;
  int untold = 0;
  for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu) {
    if (!CPU_ISSET(cpu, &set)) continue;
    const fs::path topology = root / "sys/devices/system/cpu" / ("cpu" + std::to_string(cpu)) / "topology";
    const std::string names = first_line(topology / "thread_siblings_list");
    if (names.empty()) {
      ++untold;
    } else {
      siblings.insert(names);
    }
  }
  cores.physical = std::max(1, static_cast<int>(siblings.size()) + untold);
  return cores;
}

int default_thread_count(const Cores& cores) {
  if (cores.asked > 0) return cores.asked;
  double granted = std::ceil(cores.quota);
  if (cores.per_task > 0) granted = std::min(granted, double(cores.per_task));
  return granted < cores.physical ? std::max(1, static_cast<int>(granted)) : cores.physical;
}

int shared_thread_count(const Cores& cores, int processes) {
  Cores own = cores;
  const int part = std::max(1, cores.launcher / processes);
  if (cores.allowed > part) own.physical = std::max(1, cores.physical * part / cores.allowed);
  own.quota = cores.quota / processes;
  return default_thread_count(own);
}

}  // namespace anigen
