#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/nn/torch.h"

namespace anigen::nn {

/// Lines for --version: LibTorch, BLAS, CUDA.
std::string version_details();

/// Set-up of every program that computes with tensors; the whole policy on threads is here and in
/// core/parallel.h.
///  - Threads: core::parallel_for (TBB), LibTorch's operators and our kernels (OpenMP), and OpenBLAS and oneDNN inside
///    them, which use the same OpenMP threads, all get `threads`; 0: default_thread_count(). Parts that run beside each
///    other divide them: replicas of a training (train/stage.h), workers of a preparation, jobs of an experiment.
///    Nothing runs operators beside each other, so LibTorch's second pool has one thread.
///  - Memory: freed memory stays with the process (core/log.h).
///  - BLAS: a slow one is named (nn/profile.h).
void set_up_computing(int threads);

/// "cpu", "cuda" or "cuda:N"; "cuda" is the first. @throws InputError for another word or a device that is not there
torch::Device parse_device(const std::string& name);

/// Work of an operator: what no implementation on this machine can leave out.
struct Work {
  double fp32 = 0.0;   ///< floating-point operations of products of fp32 numbers, multiplications and additions
  double bf16 = 0.0;   ///< of products whose factors are bf16
  double bytes = 0.0;  ///< read and written by LibTorch's elementwise operators and copies; 0 for our own kernels

  Work& operator+=(const Work& other);
};

/// True while an OperatorProfile lives.
bool is_profiled();

/// Adds floating-point operations to the marked part of our code that this thread is in; nothing without a profile.
/// @param mixed factors are rounded to bf16
void count_operations(double operations, bool mixed);

/// The machine's own peak, measured with this thread's number of threads: the best of a few large products and copies.
struct MachinePeak {
  double fp32 = 0.0, bf16 = 0.0;  ///< operations per second; bf16: 0 where the CPU has no such products
  double bytes = 0.0;             ///< per second, read and written
};
MachinePeak measure_machine_peak();

/// Measures where the time goes, operator by operator, for as long as it lives: LibTorch's operators, the nodes of the
/// backward pass, and the parts of our code that are marked with RECORD_USER_SCOPE("group: part"). Counts all threads
/// that call operators; threads that help inside one count as part of it. One at a time.
class OperatorProfile {
 public:
  struct Row {
    std::string name;    ///< "aten::addmm", "MmBackward0", "attention: dense"
    std::int64_t calls;  ///< how often
    double seconds;      ///< wall time without what is measured inside it
    Work work = {};
  };

  OperatorProfile();
  ~OperatorProfile();
  OperatorProfile(const OperatorProfile&) = delete;
  OperatorProfile& operator=(const OperatorProfile&) = delete;

  /// So far, longest first.
  std::vector<Row> rows() const;

  /// Purpose of an operator: the text before the colon of our own scopes; of LibTorch's operators "matrix products"
  /// (dense convolutions count as such), else "elementwise and copies".
  static std::string group_of(const std::string& name);

  /// Rows of the same group added up, longest first.
  static std::vector<Row> by_group(const std::vector<Row>& rows);

 private:
  std::uint64_t callback_ = 0;
};

/// Two Markdown tables, of groups and of the longest operators, with times per step, shares of all, and GFLOP/s; before
/// them the floor of a step, which is its work at the machine's peak.
/// @param steps during which the rows were measured
std::string profile_markdown(const std::vector<OperatorProfile::Row>& rows, std::int64_t steps,
                             const MachinePeak& peak);

}  // namespace anigen::nn
