#pragma once
#include <functional>
#include <string>

namespace anigen::train {

/// Where the ranks of a run find each other.
struct Rendezvous {
  std::string file;  ///< path of a file that all ranks see; empty: by TCP
  std::string host;  ///< of rank 0; empty together with `file`: nowhere
  int port = 0;
  bool served = false;  ///< the launcher serves host:port itself (torchrun's agent): rank 0 must not
  std::string attempt;  ///< tells the keys of a restarted run from those it left behind

  bool given() const { return !file.empty() || !host.empty(); }
  std::string text() const;  ///< "file:///path" or "tcp://host:port"
};

/// Which of how many processes this one is, from what its launcher has put into the environment.
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

/// The same, of this process.
LaunchEnvironment read_launch_environment(const std::string& rendezvous);

/// First host of a SLURM node list: "gpu[003-007,12],login1" → "gpu003".
/// @throws InputError naming `variable` when the list is malformed
std::string first_host(const std::string& list, const std::string& variable);

/// Tasks on one node by SLURM's list of all: "2(x3),1" is 2 on nodes 0, 1 and 2, and 1 on node 3.
/// @throws InputError naming `variable` when the list is malformed or has fewer nodes
int tasks_of_node(const std::string& list, int node, const std::string& variable);

}  // namespace anigen::train
