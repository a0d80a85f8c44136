#include "anigen/core/parallel.h"

#include <gtest/gtest.h>
#include <sched.h>

#include <stdexcept>
#include <vector>

namespace anigen {
namespace {

TEST(ParallelFor, VisitsEveryIndexOnceForAnyThreadCount) {
  for (const int threads : {1, 2, 5}) {
    set_thread_count(threads);
    EXPECT_EQ(thread_count(), threads);
    std::vector<int> visits(1000, 0);
    parallel_for(visits.size(), [&](std::size_t i) { ++visits[i]; });
    EXPECT_EQ(visits, std::vector<int>(1000, 1));
  }
  set_thread_count(0);
}

// A job that was given one core of a large machine must not start a thread for every core there is.
TEST(ThreadCount, IsThatOfTheCoresTheProcessMayUse) {
  cpu_set_t before, one;
  ASSERT_EQ(::sched_getaffinity(0, sizeof before, &before), 0);
  CPU_ZERO(&one);
  for (int cpu = 0; cpu < CPU_SETSIZE && CPU_COUNT(&one) == 0; ++cpu) {
    if (CPU_ISSET(cpu, &before)) CPU_SET(cpu, &one);
  }
  ASSERT_EQ(::sched_setaffinity(0, sizeof one, &one), 0);
  set_thread_count(0);
  EXPECT_EQ(thread_count(), 1);
  ASSERT_EQ(::sched_setaffinity(0, sizeof before, &before), 0);
  set_thread_count(0);
  EXPECT_EQ(thread_count(), CPU_COUNT(&before));
}

TEST(ParallelFor, PassesExceptionsOn) {
  EXPECT_THROW(parallel_for(100,
                            [](std::size_t i) {
                              if (i == 37) throw std::runtime_error("37");
                            }),
               std::runtime_error);
}

}  // namespace
}  // namespace anigen
