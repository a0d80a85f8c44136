#pragma once
/// The only place that includes headers of c10d, LibTorch's library for several processes, and knows what it was built
/// with. ANIGEN_HAS_C10D is 1 when there is Gloo to talk through, whose headers c10d's need (Debian: libgloo-dev).
#include "anigen/nn/torch.h"

#if defined(USE_C10D_GLOO) && defined(ANIGEN_WITH_GLOO) && __has_include(<gloo/context.h>)
#define ANIGEN_HAS_C10D 1
#include <torch/csrc/distributed/c10d/FileStore.hpp>
#include <torch/csrc/distributed/c10d/PrefixStore.hpp>
#include <torch/csrc/distributed/c10d/ProcessGroupGloo.hpp>
#include <torch/csrc/distributed/c10d/TCPStore.hpp>
#if defined(USE_C10D_NCCL) && __has_include(<nccl.h>)
#define ANIGEN_HAS_NCCL 1
#include <torch/csrc/distributed/c10d/ProcessGroupNCCL.hpp>
#else
#define ANIGEN_HAS_NCCL 0
#endif

namespace anigen::train {

/// What the process groups of one library have in common.
#if ANIGEN_TORCH_AT_LEAST(2, 0)
using ProcessGroup = c10d::Backend;
#else
using ProcessGroup = c10d::ProcessGroup;
#endif

}  // namespace anigen::train
#else
#define ANIGEN_HAS_C10D 0
#endif
