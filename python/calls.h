#pragma once
#include <pybind11/pybind11.h>
#include <exception>
#include <memory>
#include <optional>
#include <string>

#include "anigen/anigen.h"

namespace anigen::python {

/// Calls work without the interpreter's lock.
template <typename Work>
auto unlocked(Work&& work) {
  const pybind11::gil_scoped_release release;
  return work();
}

using ProgressFunction = std::optional<pybind11::function>;

/// One call of the library that tells a Python function of its progress. False or an exception from it ends the call,
/// and the function hears no more. To be made and destroyed with the interpreter's lock.
class WatchedCall {
 public:
  explicit WatchedCall(const ProgressFunction& progress) {
    if (!progress) return;
    // Heard from any thread, without the interpreter's lock.
    job_ = std::make_unique<Job>([this, function = *progress](const std::string& stage, double fraction) {
      if (ended()) return;
      const pybind11::gil_scoped_acquire lock;
      try {
        if (function(stage, fraction).is(pybind11::bool_(false))) job_->cancel();
      } catch (const pybind11::error_already_set&) {
        // Kept, since Job drops what is thrown here.
        error_ = std::current_exception();
        job_->cancel();
      }
    });
  }
  WatchedCall(const WatchedCall&) = delete;
  WatchedCall& operator=(const WatchedCall&) = delete;

  /// Calls work(Job*) without the interpreter's lock.
  /// @throws what the function raised, or Interrupted when it returned False, however the work then ended
  template <typename Work>
  auto run(Work&& work) {
    try {
      auto result = unlocked([&] { return work(job_.get()); });
      if (!ended()) return result;
    } catch (...) {
      if (!ended()) throw;
    }
    if (error_) std::rethrow_exception(error_);
    throw Interrupted("cancelled");
  }

 private:
  bool ended() const { return job_ != nullptr && job_->cancelled(); }

  std::exception_ptr error_;  ///< of the function; read and written with the interpreter's lock
  std::unique_ptr<Job> job_;  ///< null without a function
};

}  // namespace anigen::python
