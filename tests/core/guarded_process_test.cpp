#include "anigen/core/guarded_process.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstdlib>
#include <functional>
#include <stdexcept>
#include <string>

namespace anigen {
namespace {

TEST(GuardedProcess, GivesBackWhatTheWorkReturns) {
  std::string large(3'000'000, 'x');  // many times what a pipe holds
  large[1'234'567] = '\0';
  const GuardedWork work = run_guarded([&] { return large; }, {});
  EXPECT_TRUE(work.finished);
  EXPECT_EQ(work.result, large);
  EXPECT_EQ(work.failure, "");
  EXPECT_TRUE(run_guarded([] { return std::string(); }, {}).finished) << "nothing is a result, too";
}

TEST(GuardedProcess, LeavesNothingBehindInThisProcess) {
  int value = 1;
  const GuardedWork work = run_guarded([&] { return std::to_string(value = 2); }, {});
  EXPECT_EQ(work.result, "2");
  EXPECT_EQ(value, 1);
}

TEST(GuardedProcess, OutlivesACrash) {
  const auto failure = [](const std::function<void()>& end) {
    const GuardedWork work = run_guarded(
        [&] {
          end();
          return std::string("not reached");
        },
        {});
    EXPECT_FALSE(work.finished);
    EXPECT_EQ(work.result, "");
    return work.failure;
  };
  EXPECT_EQ(failure([] { ::raise(SIGSEGV); }), "crashed (Segmentation fault)");
  EXPECT_EQ(failure([] { std::abort(); }), "crashed (Aborted)");
  EXPECT_EQ(failure([] { throw std::runtime_error("?"); }), "crashed (status 3)");
  EXPECT_EQ(failure([] { ::_exit(0); }), "crashed (status 0)") << "without a result nothing was finished";
}

TEST(GuardedProcess, EndsWhatNeverEnds) {
  ProcessLimits limits;
  limits.cpu_seconds = 1.0;
  const GuardedWork work = run_guarded(
      [] {
        for (volatile unsigned spin = 0;; spin = spin + 1) {
        }
        return std::string();
      },
      limits);
  EXPECT_FALSE(work.finished);
  EXPECT_EQ(work.failure, "took more than 1 s of processor time");
}

TEST(GuardedProcess, BoundsTheMemory) {
  ProcessLimits limits;
  limits.more_memory = std::uint64_t{256} << 20;
  const auto reserves = [&](std::size_t mebibytes) {
    return run_guarded(
               [&] {
                 void* memory =
                     ::mmap(nullptr, mebibytes << 20, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
                 return std::string(memory == MAP_FAILED ? "refused" : "there");
               },
               limits)
        .result;
  };
  EXPECT_EQ(reserves(16), "there");
  EXPECT_EQ(reserves(1024), "refused");
}

}  // namespace
}  // namespace anigen
