#pragma once
#include <memory>

#include "anigen/nn/torch.h"
#include "anigen/train/distributed/communicator.h"
#include "anigen/train/distributed/launch_environment.h"

namespace anigen::train {

/// How ranks talk to each other. Settings of a launch, not of a config: none changes what is trained.
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
