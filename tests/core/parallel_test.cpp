#include <gtest/gtest.h>
#include <sched.h>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <stdexcept>
#include <vector>

#include "anigen/core/parallel.h"
#include "tests/support/paths.h"

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

namespace {

namespace fs = std::filesystem;

void put(const fs::path& file, const std::string& text) {
  fs::create_directories(file.parent_path());
  std::ofstream(file) << text;
}

/// Cores found outside a job of SLURM, which these tests may be run in.
Cores find_outside_jobs(const fs::path& root) {
  ::unsetenv("SLURM_CPUS_ON_NODE");
  ::unsetenv("SLURM_CPUS_PER_TASK");
  return find_cores(root);
}

TEST(Cores, QuotaOfVersionTwoIsTheTightestOnTheWay) {
  test::TemporaryFolder root;
  put(root / "proc/self/cgroup", "0::/jobs/mine\n");
  put(root / "sys/fs/cgroup/jobs/cpu.max", "150000 100000\n");
  put(root / "sys/fs/cgroup/jobs/mine/cpu.max", "max 100000\n");
  EXPECT_DOUBLE_EQ(find_outside_jobs(root.path()).quota, 1.5);
}

TEST(Cores, QuotaOfVersionOne) {
  test::TemporaryFolder root;
  put(root / "proc/self/cgroup", "9:memory:/docker/ab\n4:cpu,cpuacct:/docker/ab\n");
  // Seen from inside the container, the group is the top of what is mounted.
  put(root / "sys/fs/cgroup/cpu/cpu.cfs_quota_us", "400000\n");
  put(root / "sys/fs/cgroup/cpu/cpu.cfs_period_us", "100000\n");
  EXPECT_DOUBLE_EQ(find_outside_jobs(root.path()).quota, 4.0);
  put(root / "sys/fs/cgroup/cpu/cpu.cfs_quota_us", "-1\n");
  EXPECT_TRUE(std::isinf(find_outside_jobs(root.path()).quota));
}

TEST(Cores, NothingSaidIsNoLimit) {
  test::TemporaryFolder root;
  const Cores cores = find_outside_jobs(root.path());
  EXPECT_TRUE(std::isinf(cores.quota));
  EXPECT_GE(cores.allowed, 1);
  EXPECT_EQ(cores.physical, cores.allowed);
}

TEST(Cores, WhatSlurmGrantsLimitsWhereItDoesNotConfine) {
  test::TemporaryFolder root;
  ::setenv("SLURM_CPUS_ON_NODE", "12", 1);
  ::setenv("SLURM_CPUS_PER_TASK", "3", 1);
  Cores cores = find_cores(root.path());
  EXPECT_DOUBLE_EQ(cores.quota, 12.0);
  cores.asked = 0;
  cores.allowed = cores.launcher = 64;
  cores.physical = 32;
  EXPECT_EQ(default_thread_count(cores), 3);
  EXPECT_EQ(shared_thread_count(cores, 4), 3) << "four tasks of three";
  EXPECT_EQ(shared_thread_count(cores, 6), 2) << "mpirun's, which are no tasks of SLURM";
  cores.allowed = cores.physical = 2;
  EXPECT_EQ(default_thread_count(cores), 2) << "confined to fewer";
  EXPECT_EQ(find_outside_jobs(root.path()).per_task, 0);
}

TEST(Cores, SecondThreadsOfACoreAreNotCounted) {
  test::TemporaryFolder root;
  const int allowed = find_outside_jobs(root.path()).allowed;
  for (int cpu = 0; cpu < 1024; ++cpu)
    put(root / "sys/devices/system/cpu" / ("cpu" + std::to_string(cpu)) / "topology/thread_siblings_list", "0-1023\n");
  EXPECT_EQ(find_outside_jobs(root.path()).physical, 1);
  EXPECT_EQ(find_outside_jobs(root.path()).allowed, allowed);
}

TEST(Cores, DefaultIsPhysicalWithinTheQuota) {
  Cores cores;
  cores.allowed = 64;
  cores.physical = 32;
  EXPECT_EQ(default_thread_count(cores), 32);
  cores.quota = 2.5;
  EXPECT_EQ(default_thread_count(cores), 3);
  cores.quota = 0.2;
  EXPECT_EQ(default_thread_count(cores), 1);
  cores.asked = 6;
  EXPECT_EQ(default_thread_count(cores), 6);
}

TEST(Cores, ProcessesOfALauncherShareWhatTheyAreNotBoundTo) {
  Cores cores;
  cores.allowed = cores.launcher = 64;
  cores.physical = 32;
  EXPECT_EQ(shared_thread_count(cores, 4), 8) << "unbound, with two threads per core";
  EXPECT_EQ(shared_thread_count(cores, 64), 1);
  EXPECT_EQ(shared_thread_count(cores, 100), 1);
  cores.quota = 10.0;
  EXPECT_EQ(shared_thread_count(cores, 4), 3) << "the quota is the container's";
  cores.quota = std::numeric_limits<double>::infinity();
  cores.allowed = 16;
  cores.physical = 8;
  EXPECT_EQ(shared_thread_count(cores, 4), 8) << "bound to a quarter each";
  cores.allowed = 32;
  cores.physical = 16;
  EXPECT_EQ(shared_thread_count(cores, 4), 8) << "two on each half";
  cores.launcher = 32;
  EXPECT_EQ(shared_thread_count(cores, 4), 4) << "a job that has half the machine";
  cores.launcher = 1;
  EXPECT_EQ(shared_thread_count(cores, 4), 1) << "a parent that is bound itself";
  cores.asked = 6;
  EXPECT_EQ(shared_thread_count(cores, 4), 6) << "each by itself, as torchrun's workers";
}

}  // namespace

}  // namespace anigen
