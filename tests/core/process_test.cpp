#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <functional>
#include <mutex>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/process.h"
#include "tests/support/paths.h"

namespace anigen {

namespace {

using Kind = FileLock::Kind;

TEST(FileLock, SharedOnesGoTogetherAnExclusiveOneStandsAlone) {
  const test::TemporaryFolder folder;
  const auto file = dataset_lock_file(folder / "data");
  {
    const std::optional<FileLock> first = FileLock::try_lock(file, Kind::kShared);
    ASSERT_TRUE(first) << "makes the folder, too";
    EXPECT_TRUE(FileLock::try_lock(file, Kind::kShared));
    EXPECT_FALSE(FileLock::try_lock(file, Kind::kExclusive));
  }
  std::optional<FileLock> alone = FileLock::try_lock(file, Kind::kExclusive);
  ASSERT_TRUE(alone);
  const FileLock moved = std::move(*alone);
  alone.reset();
  EXPECT_FALSE(FileLock::try_lock(file, Kind::kShared)) << "the lock goes with the object";
}

TEST(FileLock, SaysWhatCannotBeOpened) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(FileLock::try_lock(folder.path(), Kind::kShared), Error) << "a folder";
}

}  // namespace

namespace {

TEST(GroupLock, HasExactlyOneFirst) {
  const test::TemporaryFolder folder;
  const auto file = folder / "lock";
  std::atomic<int> firsts{0}, members{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i) {
    threads.emplace_back([&] {
      const auto lock = join_group(file, [&](bool first) { firsts += first ? 1 : 0; });
      ++members;
      while (members < 8) std::this_thread::yield();
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(firsts, 1);
  bool first = false;
  const auto again = join_group(file, [&](bool is_first) { first = is_first; });
  EXPECT_TRUE(first) << "the others have left";
}

TEST(GroupLock, KeepsApartMembersAndWhoWantsThePlaceAlone) {
  const test::TemporaryFolder folder;
  const auto file = folder / "lock";
  {
    const auto member = join_group(file, [](bool) {});
    EXPECT_FALSE(instead_of_group(file));
    EXPECT_FALSE(while_group_is_empty(file, [] { FAIL() << "there is a member"; }));
  }
  EXPECT_TRUE(while_group_is_empty(file, [] {}));
  const auto alone = instead_of_group(file);
  ASSERT_TRUE(alone);
  EXPECT_FALSE(join_group(file, [](bool) { FAIL() << "somebody is there"; }));
}

TEST(GroupLock, WhoIsRefusedAtTheGateIsNoMember) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(join_group(folder / "lock", [](bool) { throw InputError("", "", "not you"); }), InputError);
  EXPECT_TRUE(instead_of_group(folder / "lock"));
}

}  // namespace

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

TEST(GuardedProcess, IsEndedByWhatTheWaitThrows) {
  ProcessLimits limits;
  int waits = 0;
  limits.while_waiting = [&] {
    if (++waits == 3) throw Interrupted("enough");
  };
  const auto never_ends = [] {
    for (;;) ::pause();
    return std::string();
  };
  EXPECT_THROW(run_guarded(never_ends, limits), Interrupted);
  EXPECT_EQ(waits, 3);
}

TEST(GuardedProcess, BeginsAgainWhenItWaitsForALockThatNobodyGivesBack) {
  // A library's lock is held by another thread when the first copy is made.
  std::mutex lock;
  std::atomic<bool> held{false}, enough{false};
  std::thread other([&] {
    lock.lock();
    held = true;
    while (!enough) std::this_thread::sleep_for(std::chrono::milliseconds(1));
    lock.unlock();
  });
  while (!held) std::this_thread::yield();
  ProcessLimits limits;
  const auto start = std::chrono::steady_clock::now();
  limits.while_waiting = [&] { enough = true; };
  const GuardedWork work = run_guarded(
      [&] {
        const std::lock_guard<std::mutex> waits(lock);
        return std::string("read");
      },
      limits);
  other.join();
  EXPECT_TRUE(work.finished) << work.failure;
  EXPECT_EQ(work.result, "read");
  EXPECT_LT(std::chrono::steady_clock::now() - start, std::chrono::seconds(60)) << "not the patience for the whole";
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

/// Work that a hostile file has taken over: it announces a result of so many bytes, and sends bytes until it is ended.
std::string send_without_end(std::uint64_t announced) {
  for (int file = STDERR_FILENO + 1; file < 1024; ++file) {
    const int mode = ::fcntl(file, F_GETFL);
    struct stat what {};
    if (mode < 0 || (mode & O_ACCMODE) != O_WRONLY || ::fstat(file, &what) != 0 || !S_ISFIFO(what.st_mode)) continue;
    const std::string bytes(1 << 20, 'x');
    if (::write(file, &announced, sizeof announced) != sizeof announced) break;
    while (::write(file, bytes.data(), bytes.size()) > 0) {
    }
  }
  return "";
}

TEST(GuardedProcess, BoundsTheResult) {
  ProcessLimits limits;
  limits.cpu_seconds = 5.0;
  limits.more_memory = std::uint64_t{256} << 20;
  for (const std::uint64_t announced : {~std::uint64_t{0}, limits.more_memory + 1}) {
    const GuardedWork work = run_guarded([&] { return send_without_end(announced); }, limits);
    EXPECT_FALSE(work.finished);
    EXPECT_EQ(work.failure, "sent back more than it may hold in memory");
  }
  const GuardedWork work = run_guarded([] { return send_without_end(3); }, limits);
  EXPECT_TRUE(work.finished);
  EXPECT_EQ(work.result, "xxx") << "as many bytes as were announced";
}

}  // namespace

namespace {

ChildProcess::End end_of(ChildProcess& child) {
  for (;;) {
    if (const auto end = child.poll()) return *end;
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
}

TEST(ChildProcess, WritesItsOutputToALogWithItsOwnVariables) {
  const test::TemporaryFolder folder;
  ChildProgram program;
  program.words = {"/bin/sh", "-c", "echo out $ANIGEN_TEST; echo err >&2; cat; exit 3"};
  program.environment = {"ANIGEN_TEST=7", "HOME=/nowhere"};
  program.log = folder / "logs" / "log.txt";
  ChildProcess child(program);
  EXPECT_EQ(end_of(child).status, 3);
  EXPECT_FALSE(child.poll());
  EXPECT_EQ(read_file(program.log, 1000), "out 7\nerr\n");
}

TEST(ChildProcess, IsSpokenToThroughPipes) {
  ChildProgram program;
  program.words = {"/bin/cat"};
  program.pipes = true;
  ChildProcess child(program);
  ASSERT_EQ(::write(child.input(), "hello", 5), 5);
  std::string heard;
  while (heard.size() < 5) {
    char buffer[16];
    const ssize_t n = ::read(child.output(), buffer, sizeof buffer);
    if (n > 0) heard.append(buffer, static_cast<std::size_t>(n));
  }
  EXPECT_EQ(heard, "hello");
  child.send(SIGKILL);
  EXPECT_EQ(end_of(child).status, -SIGKILL);
}

TEST(ChildProcess, EndsWhenItIsAskedOrDestroyed) {
  ChildProgram program;
  program.words = {"/bin/sleep", "1000"};
  ChildProcess asked(program);
  asked.ask_to_stop();
  EXPECT_EQ(end_of(asked).status, -SIGTERM);
  pid_t id = -1;
  {
    ChildProcess dropped(program);
    id = dropped.id();
    ChildProcess moved(std::move(dropped));
    EXPECT_EQ(dropped.id(), -1);  // NOLINT(bugprone-use-after-move)
    EXPECT_EQ(moved.id(), id);
  }
  EXPECT_NE(::kill(id, 0), 0);
}

TEST(ChildProcess, ThatCannotBeRunEndsWithStatus127) {
  const test::TemporaryFolder folder;
  ChildProgram program;
  program.words = {"/nowhere/program"};
  program.log = folder / "log.txt";
  ChildProcess child(program);
  EXPECT_EQ(end_of(child).status, 127);
  EXPECT_EQ(read_file(program.log, 1000), "cannot be run\n");
}

}  // namespace

}  // namespace anigen
