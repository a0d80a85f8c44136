#include "anigen/train/distributed/join_ranks.h"

#include "anigen/core/error.h"
#include "anigen/train/distributed/c10d_communicator.h"
#include "anigen/train/distributed/single_process.h"

namespace anigen::train {

std::shared_ptr<Communicator> join_ranks(const LaunchEnvironment& environment, const RankOptions& options) {
  if (environment.size == 1) return std::make_shared<SingleProcess>();
  if (options.sent != torch::kFloat32 && options.sent != torch::kBFloat16) {
    throw InputError("--communication", torch::toString(options.sent), "expected fp32 or bf16");
  }
#if ANIGEN_HAS_C10D
  return std::make_shared<C10dCommunicator>(environment, options);
#else
  throw NotSupportedError("", environment.launcher,
                          "training by several processes; this build found no Gloo (LibTorch with c10d, libgloo-dev)");
#endif
}

}  // namespace anigen::train
