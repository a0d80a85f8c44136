// Rights that a process gives up: the calls fail with an error code, and the rest goes on.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <signal.h>
#include <sys/mount.h>
#include <sys/ptrace.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>
#include <cerrno>
#include <cstring>
#include <functional>
#include <string>
#include <thread>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/process.h"
#include "anigen/core/sandbox.h"
#include "tests/support/paths.h"

namespace anigen {

namespace {

namespace fs = std::filesystem;

/// Name of what a call that gives a negative number fails with; "done" when it does not.
std::string call(long result) { return result >= 0 ? "done" : ::strerrorname_np(errno); }

/// Text that work gives in a process with those rights.
std::string held(const SandboxRights& rights, const std::function<std::string()>& work) {
  const GuardedWork outcome = run_guarded(
      [&] {
        enter_sandbox(rights);
        return work();
      },
      {});
  return outcome.finished ? outcome.result : outcome.failure;
}

class Sandbox : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!sandbox_means().calls) GTEST_SKIP() << "this kernel has no seccomp filters";
  }
  test::TemporaryFolder folder_;
};

TEST_F(Sandbox, RefusesTheNetwork) {
  const auto try_socket = [](int family, int type) {
    return held({}, [=] { return call(::socket(family, type, 0)); });
  };
  EXPECT_EQ(try_socket(AF_INET, SOCK_STREAM), "EPERM");
  EXPECT_EQ(try_socket(AF_INET6, SOCK_DGRAM), "EPERM");
  EXPECT_EQ(try_socket(AF_UNIX, SOCK_STREAM), "EPERM") << "services of this machine";
  const int open_before = ::socket(AF_UNIX, SOCK_STREAM, 0);
  ASSERT_GE(open_before, 0);
  sockaddr_un nowhere{};
  nowhere.sun_family = AF_UNIX;
  std::strcpy(nowhere.sun_path, "/no/such/socket");
  EXPECT_EQ(
      held({},
           [&] { return call(::connect(open_before, reinterpret_cast<const sockaddr*>(&nowhere), sizeof nowhere)); }),
      "EPERM");
  ::close(open_before);
}

TEST_F(Sandbox, RefusesProgramsAndProcesses) {
  const auto run = [] {
    char name[] = "/bin/true";
    char* const words[] = {name, nullptr};
    return call(::execv(name, words));
  };
  EXPECT_EQ(held({}, run), "EPERM");
  EXPECT_EQ(held({}, [] { return call(::fork()); }), "EPERM");
  EXPECT_EQ(held({}, [] { return call(::vfork()); }), "EPERM");
  EXPECT_EQ(held({}, [] { return std::system("true") == 0 ? "done" : "refused"; }), "refused");
  SandboxRights rights;
  rights.processes = true;
  EXPECT_EQ(held(rights, run), "EPERM");
}

TEST_F(Sandbox, AllowsCopiesOfItselfWhichAreHeldToo) {
  SandboxRights rights;
  rights.processes = true;
  const std::string outcome = held(rights, [] {
    const GuardedWork copy = run_guarded([] { return call(::socket(AF_INET, SOCK_STREAM, 0)); }, {});
    ChildProcess endless(::fork(), SIGKILL);
    if (endless.id() == 0)
      for (;;) ::pause();
    endless.send(SIGKILL);  // a signal to one of its own
    while (!endless.poll()) ::usleep(1000);
    return copy.result;
  });
  EXPECT_EQ(outcome, "EPERM");
}

TEST_F(Sandbox, RefusesWhatReachesOtherProcessesAndTheSystem) {
  const pid_t parent = ::getpid();
  const auto refusal = [](const std::function<long()>& work) { return held({}, [&] { return call(work()); }); };
  EXPECT_EQ(refusal([] { return ::ptrace(PTRACE_TRACEME, 0, 0, 0); }), "EPERM");
  EXPECT_EQ(refusal([=] { return ::kill(parent, 0); }), "EPERM");
  EXPECT_EQ(refusal([=] { return ::syscall(SYS_tgkill, parent, parent, 0); }), "EPERM");
  EXPECT_EQ(refusal([] { return ::unshare(CLONE_NEWUSER); }), "EPERM");
  EXPECT_EQ(refusal([] { return ::mount("none", "/tmp", "tmpfs", 0, nullptr); }), "EPERM");
  EXPECT_EQ(refusal([] { return ::syscall(SYS_bpf, 0, nullptr, 0); }), "EPERM");
  EXPECT_EQ(refusal([] { return ::syscall(425, 8, nullptr); }), "EPERM") << "io_uring, which has calls of its own";
  EXPECT_EQ(refusal([] { return ::kill(::getpid(), 0); }), "done") << "itself";
}

TEST_F(Sandbox, LeavesReadingAndThreadsAlone) {
  write_file_atomically(folder_ / "a", "text");
  const std::string outcome = held({}, [&] {
    std::string read;
    std::thread reader([&] { read = read_file(folder_ / "a"); });
    reader.join();
    for (const fs::directory_entry& entry : fs::directory_iterator(folder_.path()))
      read += " " + entry.path().filename().string();
    return read;
  });
  EXPECT_EQ(outcome, "text a");
}

TEST_F(Sandbox, AbortStaysAnAbort) {
  EXPECT_EQ(held({}, []() -> std::string { std::abort(); }), "crashed (Aborted)");
}

TEST_F(Sandbox, WithoutAFolderNoFileChanges) {
  const std::string file = folder_ / "a", other = folder_ / "b";
  write_file_atomically(file, "text");
  const auto refused = [&](const std::function<long()>& work) {
    const std::string name = held({}, [&] { return call(work()); });
    return name == "EPERM" || name == "EACCES" ? "refused" : name;
  };
  EXPECT_EQ(refused([&] { return ::open(file.c_str(), O_WRONLY); }), "refused");
  EXPECT_EQ(refused([&] { return ::open(file.c_str(), O_RDWR); }), "refused");
  EXPECT_EQ(refused([&] { return ::open(file.c_str(), O_RDONLY | O_TRUNC); }), "refused");
  EXPECT_EQ(refused([&] { return ::open(other.c_str(), O_RDONLY | O_CREAT, 0600); }), "refused");
  EXPECT_EQ(refused([&] { return ::syscall(SYS_truncate, file.c_str(), 0); }), "refused");
  EXPECT_EQ(refused([&] { return ::unlink(file.c_str()); }), "refused");
  EXPECT_EQ(refused([&] { return ::rename(file.c_str(), other.c_str()); }), "refused");
  EXPECT_EQ(refused([&] { return ::link(file.c_str(), other.c_str()); }), "refused");
  EXPECT_EQ(refused([&] { return ::symlink(file.c_str(), other.c_str()); }), "refused");
  EXPECT_EQ(refused([&] { return ::mkdir(other.c_str(), 0700); }), "refused");
  EXPECT_EQ(refused([&] { return ::chmod(file.c_str(), 0600); }), "refused");
  EXPECT_EQ(refused([&] { return ::open(file.c_str(), O_RDONLY); }), "done");
  EXPECT_EQ(read_file(file), "text");
}

TEST_F(Sandbox, WritesInItsFolderAlone) {
  if (!sandbox_means().folders) GTEST_SKIP() << "this kernel has no Landlock";
  fs::create_directories(folder_ / "own");
  write_file_atomically(folder_ / "other", "kept");
  fs::create_symlink("../other", folder_ / "own" / "link");
  SandboxRights rights;
  rights.writable = {folder_ / "own"};
  rights.file_bytes = 1 << 20;
  const auto problem = [&](const std::function<void()>& work) {
    return held(rights, [&]() -> std::string {
      try {
        work();
      } catch (const std::exception& error) {
        return error.what();
      }
      return "done";
    });
  };
  EXPECT_EQ(problem([&] { write_file_atomically(folder_ / "own" / "below" / "a", "text"); }), "done");
  EXPECT_EQ(problem([&] { fs::rename(folder_ / "own" / "below" / "a", folder_ / "own" / "a"); }), "done");
  EXPECT_EQ(read_file(folder_ / "own" / "a"), "text");
  EXPECT_EQ(problem([&] { fs::remove_all(folder_ / "own" / "below"); }), "done");
  const std::string outside = problem([&] { write_file_atomically(folder_ / "new", "text"); });
  EXPECT_NE(outside.find((folder_ / "new").string()), std::string::npos) << outside << ": names the file";
  EXPECT_NE(outside.find("Permission denied"), std::string::npos) << outside;
  EXPECT_NE(problem([&] { fs::rename(folder_ / "own" / "a", folder_ / "a"); }), "done");
  EXPECT_NE(problem([&] { fs::remove(folder_ / "other"); }), "done");
  EXPECT_EQ(held(rights, [&] { return call(::open((folder_ / "own" / "link").c_str(), O_WRONLY)); }), "EACCES");
  EXPECT_EQ(read_file(folder_ / "other"), "kept");
  EXPECT_FALSE(fs::exists(folder_ / "new"));
}

TEST_F(Sandbox, AFolderThatIsNotThereIsAnError) {
  SandboxRights rights;
  rights.writable = {folder_ / "none"};
  EXPECT_THROW(enter_sandbox(rights), Error);
}

TEST_F(Sandbox, AFileThatGrowsTooLargeIsAnError) {
  SandboxRights rights;
  rights.writable = {folder_.path()};
  rights.file_bytes = 1000;
  const std::string outcome = held(rights, [&]() -> std::string {
    write_file_atomically(folder_ / "small", std::string(1000, 'x'));
    try {
      write_file_atomically(folder_ / "large", std::string(1001, 'x'));
    } catch (const WriteError& error) {
      return error.what();
    }
    return "done";
  });
  EXPECT_NE(outcome.find("File too large"), std::string::npos) << outcome;
  EXPECT_EQ(fs::file_size(folder_ / "small"), 1000u);
  EXPECT_FALSE(fs::exists(folder_ / "large"));
}

TEST_F(Sandbox, LimitsFilesThatAreOpenAtOnce) {
  SandboxRights rights;
  rights.more_files = 10;
  const std::string outcome = held(rights, [] {
    int opened = 0;
    while (::open("/", O_RDONLY) >= 0) ++opened;
    return std::to_string(opened) + " " + ::strerrorname_np(errno);
  });
  EXPECT_EQ(outcome.substr(outcome.find(' ')), " EMFILE");
  EXPECT_GE(std::stoi(outcome), 10);
}

TEST_F(Sandbox, GuardedWorkEntersItWithoutTheFilesOfItsParent) {
  const int open_before = ::open((folder_ / "a").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
  ASSERT_GE(open_before, 0);
  ProcessLimits limits;
  limits.sandbox = SandboxRights();
  const std::string large(300'000, 'x');
  const GuardedWork work = run_guarded(
      [&] { return call(::write(open_before, "x", 1)) + " " + call(::socket(AF_INET, SOCK_STREAM, 0)) + large; },
      limits);
  EXPECT_EQ(work.result, "EBADF EPERM" + large);
  ::close(open_before);
}

}  // namespace

}  // namespace anigen
