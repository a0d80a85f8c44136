#include <gtest/gtest.h>
#include <atomic>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/job.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/process.h"

namespace anigen {

namespace {

TEST(Job, HearsTheProgressOfItsWork) {
  std::vector<std::pair<std::string, double>> heard;
  Job job([&](const std::string& stage, double fraction) { heard.emplace_back(stage, fraction); });
  {
    const JobScope scope(&job);
    Progress progress("counting", 4);
    for (int i = 0; i < 4; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(60));
      progress.advance();
    }
    progress.finish();
  }
  EXPECT_EQ(current_job(), nullptr);
  ASSERT_GE(heard.size(), 4U);
  EXPECT_EQ(heard.front(), std::make_pair(std::string("counting"), 0.25));
  EXPECT_EQ(heard.back(), std::make_pair(std::string("counting"), 1.0));
}

TEST(Job, IsCancelledByItselfAlone) {
  Job one, other;
  one.cancel();
  EXPECT_NO_THROW(throw_if_interrupted());
  {
    const JobScope scope(&other);
    EXPECT_NO_THROW(throw_if_interrupted());
    const JobScope inner(&one);
    EXPECT_TRUE(interrupt_requested());
    EXPECT_THROW(throw_if_interrupted(), Interrupted);
  }
  std::thread([&] {
    const JobScope scope(&other);
    EXPECT_FALSE(interrupt_requested());
  }).join();
}

TEST(Job, IsThatOfTheThreadsOfParallelFor) {
  Job job;
  const JobScope scope(&job);
  set_thread_count(4);
  std::atomic<int> found{0};
  parallel_for(200, [&](std::size_t) { found += current_job() == &job; });
  EXPECT_EQ(found, 200);
  std::atomic<int> begun{0};
  EXPECT_THROW(parallel_for(100'000,
                            [&](std::size_t) {
                              throw_if_interrupted();
                              if (++begun == 10) job.cancel();
                            }),
               Interrupted);
  EXPECT_LT(begun, 100'000);
  set_thread_count(0);
}

TEST(Job, IsCancelledByAWatcherThatThrows) {
  Job job([](const std::string&, double) { throw std::runtime_error("the connection is gone"); });
  EXPECT_NO_THROW(job.report("stage", 0.5));
  EXPECT_TRUE(job.cancelled());
}

}  // namespace

}  // namespace anigen
