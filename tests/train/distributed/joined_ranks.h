#pragma once
#include <cstdlib>
#include <exception>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "anigen/train/distributed/launch.h"
#include "tests/support/paths.h"

namespace anigen::test {

/// Several ranks as threads of this process, joined over a file: each calls body(its communicator) on its own thread.
/// @return what each of them threw; null where nothing
inline std::vector<std::exception_ptr> run_ranks(int size, const std::function<void(train::Communicator&)>& body,
                                                 const train::RankOptions& options = {}) {
  const TemporaryFolder folder;
  std::vector<std::exception_ptr> errors(static_cast<std::size_t>(size));
  std::vector<std::thread> threads;
  for (int rank = 0; rank < size; ++rank) {
    threads.emplace_back([&, rank] {
      train::LaunchEnvironment environment;
      environment.rank = rank;
      environment.size = size;
      environment.launcher = "test";
      environment.rendezvous.file = (folder / "rendezvous").string();
      try {
        body(*train::join_ranks(environment, options));
      } catch (...) {
        errors[static_cast<std::size_t>(rank)] = std::current_exception();
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  return errors;
}

/// Outcomes of ranks of which none may fail.
inline void run_ranks_well(int size, const std::function<void(train::Communicator&)>& body,
                           const train::RankOptions& options = {}) {
  for (const std::exception_ptr& error : run_ranks(size, body, options)) {
    if (error) std::rethrow_exception(error);
  }
}

/// what() of an exception.
inline std::string message_of(const std::exception_ptr& error) {
  try {
    if (error) std::rethrow_exception(error);
  } catch (const std::exception& caught) {
    return caught.what();
  }
  return "no error";
}

}  // namespace anigen::test
