#pragma once
#include <cstddef>
#include <filesystem>
#include <functional>
#include <limits>

namespace anigen {

/// Threads that parallel_for uses from now on; 0 means as default_thread_count() says (cores.h). Process-wide.
void set_thread_count(int threads);
int thread_count();

/// Calls body(i) for i in [0, n), in any order, on thread_count() threads; the first exception is rethrown after
/// the others finished. Results must not depend on the order: write to slot i only.
void parallel_for(std::size_t n, const std::function<void(std::size_t)>& body);

/// Makes this process a good neighbour of others on the same processors, and loses no more than its fair part to them:
/// threads that wait for others of theirs soon give the processor away, and get it back at once when it is their turn.
/// Nothing changes while there is no other busy process. Call before LibTorch is loaded, since OpenMP reads its
/// environment then. OMP_WAIT_POLICY and GOMP_SPINCOUNT go before.
void share_processors();

/// Processors that this process may use.
struct Cores {
  int allowed = 1;   ///< processors of its affinity mask: a batch system gives a job a few of a machine's
  int physical = 1;  ///< of those, the ones that are not second threads of a core counted already
  /// Processors' worth of time that its control group grants, and SLURM the whole job on this machine.
  double quota = std::numeric_limits<double>::infinity();
  int asked = 0;     ///< OMP_NUM_THREADS, 0 when it says nothing
  int per_task = 0;  ///< processors that SLURM grants each task of its job, 0 when it says nothing
  int launcher = 1;  ///< processors of the parent's affinity mask; what binds its processes (mpirun, srun) is not bound
};

/// Asks the kernel. A container's limit (`docker --cpus 2`) shows only as a quota of its control group, version 1 or 2:
/// a program that starts a thread per visible processor there is stopped most of the time. What SLURM
/// grants shows only in SLURM_CPUS_ON_NODE and SLURM_CPUS_PER_TASK where a cluster does not confine its tasks
/// (TaskPlugin=task/none): each of several tasks on a machine would take all of it.
/// @param root of the file system with proc/ and sys/, another one in tests; what it lacks says nothing
Cores find_cores(const std::filesystem::path& root = "/");

/// Default number of threads: as many as OMP_NUM_THREADS asks for; otherwise one per physical
/// core, since two matrix products on one core only get in each other's way, and no more than the quota rounded up or
/// than SLURM grants a task.
int default_thread_count(const Cores& cores);

/// Default number of threads of one of several processes that a launcher has started on this machine for one run.
/// OMP_NUM_THREADS is what each of them asks for. Processes that are bound to no more than their part of the launcher's
/// processors have those to themselves; otherwise they share, as they share a quota.
int shared_thread_count(const Cores& cores, int processes);

}  // namespace anigen
