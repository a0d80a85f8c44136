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

/// Measures where the time goes, operator by operator, for as long as it lives: LibTorch's operators, the nodes of the
/// backward pass, and the parts of our code that are marked with RECORD_USER_SCOPE("group: part"). Counts all threads
/// that call operators; threads that help inside one count as part of it. One at a time.
class OperatorProfile {
 public:
  struct Row {
    std::string name;    ///< "aten::addmm", "MmBackward0", "attention: dense"
    std::int64_t calls;  ///< how often
    double seconds;      ///< wall time without what is measured inside it
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

/// Two Markdown tables, of groups and of the longest operators, with times per step and shares of all.
/// @param steps during which the rows were measured
std::string profile_markdown(const std::vector<OperatorProfile::Row>& rows, std::int64_t steps);

}  // namespace anigen::nn
