#include <gtest/gtest.h>

#include <map>
#include <string>

#include "anigen/core/error.h"
#include "anigen/train/distributed/launch.h"

namespace anigen::train {
namespace {

using Variables = std::map<std::string, std::string>;

LaunchEnvironment read(const Variables& values, const std::string& rendezvous = "") {
  return read_launch_environment(
      [&](const char* name) -> const char* {
        const auto found = values.find(name);
        return found == values.end() ? nullptr : found->second.c_str();
      },
      rendezvous);
}

// Place of the error that a set of variables gives: the variable's name.
std::string blamed(const Variables& values, const std::string& rendezvous = "") {
  try {
    read(values, rendezvous);
  } catch (const InputError& error) {
    return error.file();
  }
  return "no error";
}

TEST(LaunchEnvironment, WithoutALauncherThereIsOneProcess) {
  const LaunchEnvironment found = read({{"MASTER_ADDR", "host"}});
  EXPECT_EQ(found.size, 1);
  EXPECT_FALSE(found.rendezvous.given());
  EXPECT_EQ(read({{"RANK", "0"}, {"WORLD_SIZE", "1"}}).size, 1) << "one rank needs no rendezvous";
}

TEST(LaunchEnvironment, Torchrun) {
  const LaunchEnvironment found = read({{"RANK", "5"},
                                        {"WORLD_SIZE", "8"},
                                        {"LOCAL_RANK", "1"},
                                        {"LOCAL_WORLD_SIZE", "4"},
                                        {"MASTER_ADDR", "node1"},
                                        {"MASTER_PORT", "1234"},
                                        {"TORCHELASTIC_USE_AGENT_STORE", "True"},
                                        {"TORCHELASTIC_RESTART_COUNT", "2"}});
  EXPECT_EQ(found.rank, 5);
  EXPECT_EQ(found.size, 8);
  EXPECT_EQ(found.local_rank, 1);
  EXPECT_EQ(found.local_size, 4);
  EXPECT_EQ(found.launcher, "torchrun");
  EXPECT_EQ(found.rendezvous.text(), "tcp://node1:1234");
  EXPECT_TRUE(found.rendezvous.served) << "torchrun's agent listens there already";
  EXPECT_NE(found.rendezvous.attempt,
            read({{"RANK", "5"}, {"WORLD_SIZE", "8"}, {"MASTER_ADDR", "node1"}}).rendezvous.attempt)
      << "a restarted run must not meet its own old keys";
}

TEST(LaunchEnvironment, SlurmTasksAndBatchScripts) {
  Variables values{{"SLURM_PROCID", "3"},
                   {"SLURM_NTASKS", "6"},
                   {"SLURM_STEP_NUM_TASKS", "4"},
                   {"SLURM_LOCALID", "1"},
                   {"SLURM_JOB_ID", "77"},
                   {"SLURM_JOB_NODELIST", "gpu[03-07,12],login"},
                   {"SLURM_STEP_NODELIST", "gpu[05-06]"}};
  const LaunchEnvironment found = read(values);
  EXPECT_EQ(found.rank, 3);
  EXPECT_EQ(found.size, 4) << "of the step, not of the job";
  EXPECT_EQ(found.local_rank, 1);
  EXPECT_EQ(found.rendezvous.host, "gpu05");
  EXPECT_EQ(found.local_size, 1) << "not said";
  values["SLURM_TASKS_PER_NODE"] = "6";
  values["SLURM_STEP_TASKS_PER_NODE"] = "3,1";
  EXPECT_EQ(read(values).local_size, 3) << "of the step, on node 0";
  values["SLURM_NODEID"] = "1";
  EXPECT_EQ(read(values).local_size, 1);
  const int port = found.rendezvous.port;
  values["SLURM_JOB_ID"] = "78";
  EXPECT_NE(read(values).rendezvous.port, port) << "two jobs on one machine";
  // In a batch script the variables of the job are there, too, but only one process runs.
  EXPECT_EQ(read({{"SLURM_PROCID", "0"}, {"SLURM_NTASKS", "6"}, {"SLURM_JOB_NODELIST", "gpu1"}}).size, 1);
  EXPECT_EQ(
      read({{"SLURM_PROCID", "0"}, {"SLURM_NTASKS", "6"}, {"SLURM_STEP_ID", "0"}, {"SLURM_JOB_NODELIST", "gpu1"}}).size,
      6);
}

TEST(LaunchEnvironment, OpenMpiWinsOverTheSlurmThatStartedIt) {
  Variables values{
      {"OMPI_COMM_WORLD_RANK", "1"},       {"OMPI_COMM_WORLD_SIZE", "2"}, {"OMPI_COMM_WORLD_LOCAL_RANK", "1"},
      {"OMPI_COMM_WORLD_LOCAL_SIZE", "2"}, {"SLURM_PROCID", "0"},         {"SLURM_STEP_NUM_TASKS", "1"}};
  EXPECT_EQ(read(values).launcher, "Open MPI");
  EXPECT_EQ(read(values).rendezvous.host, "127.0.0.1") << "all on this machine";
  values["OMPI_COMM_WORLD_LOCAL_SIZE"] = "1";
  EXPECT_EQ(blamed(values), "MASTER_ADDR");
  EXPECT_EQ(read(values, "tcp://node1:99").rendezvous.text(), "tcp://node1:99");
}

TEST(LaunchEnvironment, TheOptionComesBeforeTheVariables) {
  Variables values{
      {"RANK", "0"}, {"WORLD_SIZE", "2"}, {"MASTER_ADDR", "node1"}, {"ANIGEN_RENDEZVOUS", "file:///tmp/a"}};
  EXPECT_EQ(read(values).rendezvous.text(), "file:///tmp/a");
  EXPECT_EQ(read(values, "file:///tmp/b").rendezvous.text(), "file:///tmp/b");
  for (const char* wrong : {"http://a:1", "tcp://a", "tcp://a:", "tcp://:1", "tcp://a:0", "tcp://a:70000", "tcp://a:x",
                            "file://relative", "file://", "file:", "tcp:"}) {
    EXPECT_EQ(blamed(values, wrong), "--rendezvous") << wrong;
  }
}

TEST(LaunchEnvironment, WrongVariablesAreNamed) {
  EXPECT_EQ(blamed({{"RANK", "0"}}), "WORLD_SIZE");
  EXPECT_EQ(blamed({{"WORLD_SIZE", "2"}}), "RANK");
  EXPECT_EQ(blamed({{"RANK", "2"}, {"WORLD_SIZE", "2"}}), "RANK");
  for (const char* size : {"0", "-1", "2x", " 2", "99999999999999999999", "0x2", "1e1"}) {
    EXPECT_EQ(blamed({{"RANK", "0"}, {"WORLD_SIZE", size}}), "WORLD_SIZE") << size;
  }
  EXPECT_EQ(blamed({{"RANK", "0"}, {"WORLD_SIZE", "2"}, {"LOCAL_WORLD_SIZE", "3"}}), "LOCAL_WORLD_SIZE");
  EXPECT_EQ(blamed({{"RANK", "0"}, {"WORLD_SIZE", "2"}, {"MASTER_ADDR", "a"}, {"MASTER_PORT", "0"}}), "MASTER_PORT");
  EXPECT_EQ(blamed({{"SLURM_PROCID", "0"}, {"SLURM_STEP_NUM_TASKS", "2"}}), "SLURM_JOB_NODELIST");
}

TEST(LaunchEnvironment, TasksOfANode) {
  EXPECT_EQ(tasks_of_node("8", 0, "L"), 8);
  EXPECT_EQ(tasks_of_node("2(x3),1", 2, "L"), 2);
  EXPECT_EQ(tasks_of_node("2(x3),1", 3, "L"), 1);
  EXPECT_EQ(tasks_of_node("4,2(x1000)", 900, "L"), 2);
  for (const char* wrong : {"", "a", "2(x", "2(x)", "2(x3", "(x3)", "0", "2(x-1)", "2(x3),", "99999999999"}) {
    EXPECT_THROW(tasks_of_node(wrong, 3, "L"), InputError) << wrong;
  }
}

TEST(LaunchEnvironment, FirstHostOfANodeList) {
  EXPECT_EQ(first_host("gpu1", "L"), "gpu1");
  EXPECT_EQ(first_host("gpu1,gpu2", "L"), "gpu1");
  EXPECT_EQ(first_host("gpu[003-007,12],login1", "L"), "gpu003");
  EXPECT_EQ(first_host("gpu[7],x", "L"), "gpu7");
  EXPECT_EQ(first_host("rack[1-2]node,login", "L"), "rack1node");
  EXPECT_EQ(first_host("login.cluster.org,gpu[1-2]", "L"), "login.cluster.org");
  for (const char* wrong : {"", ",", "gpu[", "gpu[]", "gpu[a-b]", "gpu[1", "gpu[1-", "$(reboot)", "a b"})
    EXPECT_THROW(first_host(wrong, "L"), InputError) << wrong;
}

}  // namespace
}  // namespace anigen::train
