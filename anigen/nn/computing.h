#pragma once

namespace anigen::nn {

/// What every program that computes with tensors does first; the whole policy on threads is here and in core/cores.h.
///  - Threads: core::parallel_for (TBB), LibTorch's operators and our kernels (OpenMP), and OpenBLAS and oneDNN inside
///    them, which use the same OpenMP threads, all get `threads`; 0: default_thread_count(). Parts that run beside each
///    other divide them: replicas of a training (train/workers.h), workers of a preparation, jobs of an experiment.
///    Nothing runs operators beside each other, so LibTorch's second pool has one thread.
///  - Memory: freed memory stays with the process (core/memory.h).
///  - BLAS: a slow one is named (nn/blas.h).
void set_up_computing(int threads);

}  // namespace anigen::nn
