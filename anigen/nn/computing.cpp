#include "anigen/nn/computing.h"

#include "anigen/core/memory.h"
#include "anigen/core/parallel.h"
#include "anigen/nn/blas.h"
#include "anigen/nn/torch.h"

namespace anigen::nn {

void set_up_computing(int threads) {
  keep_freed_memory();
  warn_about_blas();
  set_thread_count(threads);
  at::set_num_threads(thread_count());
  // LibTorch allows this once per process, and not after its second pool has run something.
  static const bool once = [] {
    at::set_num_interop_threads(1);
    return true;
  }();
  static_cast<void>(once);
}

}  // namespace anigen::nn
