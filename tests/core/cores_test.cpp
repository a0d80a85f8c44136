#include "anigen/core/cores.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "tests/support/paths.h"

namespace anigen {
namespace {

namespace fs = std::filesystem;

void put(const fs::path& file, const std::string& text) {
  fs::create_directories(file.parent_path());
  std::ofstream(file) << text;
}

TEST(Cores, QuotaOfVersionTwoIsTheTightestOnTheWay) {
  test::TemporaryFolder root;
  put(root / "proc/self/cgroup", "0::/jobs/mine\n");
  put(root / "sys/fs/cgroup/jobs/cpu.max", "150000 100000\n");
  put(root / "sys/fs/cgroup/jobs/mine/cpu.max", "max 100000\n");
  EXPECT_DOUBLE_EQ(find_cores(root.path()).quota, 1.5);
}

TEST(Cores, QuotaOfVersionOne) {
  test::TemporaryFolder root;
  put(root / "proc/self/cgroup", "9:memory:/docker/ab\n4:cpu,cpuacct:/docker/ab\n");
  // Seen from inside the container, the group is the top of what is mounted.
  put(root / "sys/fs/cgroup/cpu/cpu.cfs_quota_us", "400000\n");
  put(root / "sys/fs/cgroup/cpu/cpu.cfs_period_us", "100000\n");
  EXPECT_DOUBLE_EQ(find_cores(root.path()).quota, 4.0);
  put(root / "sys/fs/cgroup/cpu/cpu.cfs_quota_us", "-1\n");
  EXPECT_TRUE(std::isinf(find_cores(root.path()).quota));
}

TEST(Cores, NothingSaidIsNoLimit) {
  test::TemporaryFolder root;
  const Cores cores = find_cores(root.path());
  EXPECT_TRUE(std::isinf(cores.quota));
  EXPECT_GE(cores.allowed, 1);
  EXPECT_EQ(cores.physical, cores.allowed);
}

TEST(Cores, SecondThreadsOfACoreAreNotCounted) {
  test::TemporaryFolder root;
  const int allowed = find_cores(root.path()).allowed;
  for (int cpu = 0; cpu < 1024; ++cpu) {
    put(root / "sys/devices/system/cpu" / ("cpu" + std::to_string(cpu)) / "topology/thread_siblings_list", "0-1023\n");
  }
  EXPECT_EQ(find_cores(root.path()).physical, 1);
  EXPECT_EQ(find_cores(root.path()).allowed, allowed);
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

}  // namespace
}  // namespace anigen
