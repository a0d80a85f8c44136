#pragma once
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "anigen/nn/torch.h"
#include "anigen/train/distributed/communicator.h"

namespace anigen::train {

/// Rendezvous of the ranks of a run.
struct Rendezvous {
  std::string file;  ///< path of a file that all ranks see; empty: by TCP
  std::string host;  ///< of rank 0; empty together with `file`: nowhere
  int port = 0;
  bool served = false;  ///< the launcher serves host:port itself (torchrun's agent): rank 0 must not
  std::string attempt;  ///< tells the keys of a restarted run from those it left behind

  bool given() const { return !file.empty() || !host.empty(); }
  std::string text() const;  ///< "file:///path" or "tcp://host:port"
};

/// Rank of this process and number of processes, from what its launcher has put into the environment.
struct LaunchEnvironment {
  int rank = 0, size = 1;
  int local_rank = 0;     ///< among those of this machine
  int local_size = 1;     ///< ranks on this machine; 1 when the launcher does not say
  std::string launcher;   ///< "torchrun", "Open MPI", "SLURM"; empty: started by hand, one process
  Rendezvous rendezvous;  ///< given when size > 1
};

/// Value of an environment variable, or null.
using Variables = std::function<const char*(const char* name)>;

/// Looks for the variables of torchrun (RANK, WORLD_SIZE, LOCAL_RANK, MASTER_ADDR, MASTER_PORT), of Open MPI
/// (OMPI_COMM_WORLD_RANK, …_SIZE, …_LOCAL_RANK) and of SLURM's srun (SLURM_PROCID, SLURM_NTASKS, SLURM_LOCALID), in
/// this order: mpirun and torchrun are themselves started by srun. A batch script that calls the program without srun
/// is one process. ANIGEN_RENDEZVOUS stands for --rendezvous.
/// @param rendezvous tcp://HOST:PORT or file:///PATH, before what the environment says; empty: that
/// @throws InputError naming the variable that is missing, no number, out of range or contradicted by another
LaunchEnvironment read_launch_environment(const Variables& variables, const std::string& rendezvous);

/// As above, of this process.
LaunchEnvironment read_launch_environment(const std::string& rendezvous);

/// First host of a SLURM node list: "gpu[003-007,12],login1" → "gpu003".
/// @throws InputError naming `variable` when the list is malformed
std::string first_host(const std::string& list, const std::string& variable);

/// Tasks on one node by SLURM's list of all: "2(x3),1" is 2 on nodes 0, 1 and 2, and 1 on node 3.
/// @throws InputError naming `variable` when the list is malformed or has fewer nodes
int tasks_of_node(const std::string& list, int node, const std::string& variable);

/// `anigen-train --ranks N`: the ranks of a run as processes of this machine.
struct LocalRanks {
  int ranks = 1;
  int restarts = 0;       ///< how often all of them are started again after one has failed
  double timeout = 60.0;  ///< seconds in which the others should find out about a lost rank themselves (RankOptions)
};

/// Starts this program so many times with the same words, each told its rank, and waits. A signal to stop is handed on
/// once. When one has failed the others stop by themselves; those that do not within two timeouts are killed. Bad
/// input and an interrupted run are not started again. Ranks find each other by a file in a new folder of the temporary
/// folder, private to the user, which is removed at the end.
/// @param words argv of this program @return the exit status of the first that failed, 1 where a signal ended it; that
/// of bad input where any rank found some, since the others then fail for want of it
/// @throws Error when no process or no folder can be made
int run_local_ranks(const LocalRanks& local, const std::vector<std::string>& words);

/// Communication of the ranks. Settings of a launch, not of a config: none changes what is trained.
struct RankOptions {
  double timeout = 60.0;                ///< seconds after which a rank without sign of life is lost
  torch::Dtype sent = torch::kFloat32;  ///< of gradients on their way: fp32, or bf16 for half the volume
};

/// Finds the other ranks and connects to them: Gloo, and NCCL for tensors on a GPU where LibTorch has it. Gloo takes
/// the interfaces of GLOO_SOCKET_IFNAME, else the loopback when all ranks are on one machine, else the address from
/// which this machine reaches the rendezvous.
/// @return SingleProcess when the environment names one process
/// @throws Error naming the ranks that did not come; NotSupportedError when this build has no c10d
std::shared_ptr<Communicator> join_ranks(const LaunchEnvironment& environment, const RankOptions& options);

}  // namespace anigen::train
