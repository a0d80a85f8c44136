#include "anigen/core/lease.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdio>
#include <fstream>
#include <map>
#include <thread>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/process.h"
#include "tests/support/paths.h"

namespace anigen {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

/// Runs the body in a process of its own.
template <typename Body>
pid_t in_process(Body body) {
  const pid_t child = ::fork();
  if (child != 0) return child;
  int status = 1;
  try {
    body();
    status = 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
  }
  ::_exit(status);
}

int status_of(pid_t child) {
  int status = 0;
  ::waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

/// Lets a lease look as if its holder, on another machine, had given no sign of life for so long.
void hold_elsewhere(const fs::path& lease, int seconds_ago) {
  ProcessIdentity far = this_process();
  far.space = "another machine";
  write_file_atomically(lease, to_json(far).dump());
  struct timespec times[2];
  ::clock_gettime(CLOCK_REALTIME, &times[0]);
  times[0].tv_sec -= seconds_ago;
  times[1] = times[0];
  ASSERT_EQ(::utimensat(AT_FDCWD, lease.c_str(), times, 0), 0);
}

TEST(Leases, AreHadByOneAtATime) {
  const test::TemporaryFolder folder;
  const LeaseFolder leases(folder / "leases"), others(folder / "leases");
  std::optional<Lease> first = leases.try_take("piece");
  ASSERT_TRUE(first) << "makes the folder, too";
  EXPECT_TRUE(first->held());
  EXPECT_FALSE(others.try_take("piece"));
  EXPECT_TRUE(others.try_take("another piece"));
  const Lease moved = std::move(*first);
  first.reset();
  EXPECT_FALSE(others.try_take("piece")) << "goes with the object";
}

TEST(Leases, ComeBackWithTheObject) {
  const test::TemporaryFolder folder;
  const LeaseFolder leases(folder.path());
  for (int i = 0; i < 3; ++i) EXPECT_TRUE(leases.try_take("piece"));
}

TEST(Leases, TakeAnyTextForAName) {
  const test::TemporaryFolder folder;
  const LeaseFolder leases(folder / "leases");
  const std::string names[] = {"", ".", "../x", "a/b", "a_b", "a.1", "käfer", std::string(300, 'x')};
  std::vector<Lease> held;
  for (const std::string& name : names) {
    std::optional<Lease> lease = leases.try_take(name);
    ASSERT_TRUE(lease) << name;
    held.push_back(std::move(*lease));
  }
  for (const std::string& name : names) EXPECT_FALSE(leases.try_take(name)) << name;
  EXPECT_FALSE(fs::exists(folder / "x.1"));
}

TEST(Leases, OfADeadProcessAreTakenOverAtOnce) {
  const test::TemporaryFolder folder;
  const LeaseFolder leases(folder.path());
  const pid_t child = in_process([&] {
    const std::optional<Lease> lease = leases.try_take("piece");
    write_file_atomically(folder / "taken", "");
    ::pause();
  });
  while (!fs::exists(folder / "taken")) std::this_thread::sleep_for(5ms);
  EXPECT_FALSE(leases.try_take("piece"));
  ::kill(child, SIGKILL);
  EXPECT_EQ(status_of(child), -SIGKILL);
  EXPECT_TRUE(leases.try_take("piece"));
}

TEST(Leases, OfAnotherMachineExpireByTheFoldersClock) {
  const test::TemporaryFolder folder;
  const LeaseFolder leases(folder.path(), 60);
  hold_elsewhere(folder / "piece.1", 50);
  EXPECT_FALSE(leases.try_take("piece"));
  hold_elsewhere(folder / "piece.1", 70);
  EXPECT_TRUE(leases.try_take("piece"));
  hold_elsewhere(folder / "ahead.1", -3600);
  EXPECT_FALSE(leases.try_take("ahead")) << "a clock that was set back";
}

TEST(Leases, LiveAsLongAsTheirThreadGivesSigns) {
  const test::TemporaryFolder folder;
  const LeaseFolder leases(folder.path(), 0.3);
  const std::optional<Lease> lease = leases.try_take("piece");
  const fs::file_time_type begin = fs::last_write_time(folder / "piece.1");
  for (int i = 0; i < 200 && fs::last_write_time(folder / "piece.1") == begin; ++i) std::this_thread::sleep_for(20ms);
  EXPECT_GT(fs::last_write_time(folder / "piece.1"), begin);
  EXPECT_TRUE(lease->held());
  // Takeover by another process that found it expired.
  hold_elsewhere(folder / "piece.2", 0);
  for (int i = 0; i < 200 && lease->held(); ++i) std::this_thread::sleep_for(20ms);
  EXPECT_FALSE(lease->held());
}

/// While it lives no file can grow, as on a full disk; files of no bytes can still be made.
class FullDisk {
 public:
  FullDisk() {
    before_ = ::signal(SIGXFSZ, SIG_IGN);
    ::getrlimit(RLIMIT_FSIZE, &limit_);
    const struct rlimit none { 0, limit_.rlim_max };
    ::setrlimit(RLIMIT_FSIZE, &none);
  }
  ~FullDisk() {
    ::setrlimit(RLIMIT_FSIZE, &limit_);
    ::signal(SIGXFSZ, before_);
  }

 private:
  struct rlimit limit_ {};
  void (*before_)(int) = nullptr;
};

// A lease that cannot be marked as given back keeps its number: whoever took the next one would share the piece with
// whoever finds this number unused.
TEST(Leases, GivenBackOnAFullDiskHaveOneSuccessor) {
  const test::TemporaryFolder folder;
  const LeaseFolder leases(folder.path(), 60), others(folder.path(), 60), thirds(folder.path(), 60);
  std::optional<Lease> stalled = leases.try_take("piece");
  ASSERT_TRUE(stalled);
  hold_elsewhere(folder / "piece.1", 70);  // it stood still for longer than a lease lasts
  const std::optional<Lease> successor = others.try_take("piece");
  ASSERT_TRUE(successor);
  {
    const FullDisk full;
    stalled.reset();
  }
  EXPECT_FALSE(thirds.try_take("piece")) << "a second holder";
  EXPECT_TRUE(successor->held());
}

TEST(Leases, GivenBackOnAFullDiskAreFreeAtOnce) {
  const test::TemporaryFolder folder;
  const LeaseFolder leases(folder.path(), 60), others(folder.path(), 60);
  {
    std::optional<Lease> lease = leases.try_take("piece");
    ASSERT_TRUE(lease);
    const FullDisk full;
    lease.reset();
  }
  EXPECT_TRUE(fs::exists(folder / "piece.1")) << "its number is not used again";
  const std::optional<Lease> next = others.try_take("piece");
  EXPECT_TRUE(next);
  EXPECT_TRUE(fs::exists(folder / "piece.2"));
}

TEST(Leases, CannotBeTakenOnAFullDisk) {
  const test::TemporaryFolder folder;
  const LeaseFolder leases(folder / "leases", 60);
  leases.try_take("piece");
  {
    const FullDisk full;
    EXPECT_THROW(leases.try_take("piece"), Error);
    EXPECT_THROW(leases.try_take("other"), Error);
  }
  const std::optional<Lease> piece = leases.try_take("piece"), other = leases.try_take("other");
  EXPECT_TRUE(piece && other);
  EXPECT_FALSE(leases.try_take("piece"));
}

TEST(Leases, LeaveNothingBehindWhenToldThatAllIsDone) {
  const test::TemporaryFolder folder;
  const LeaseFolder leases(folder / "leases");
  std::optional<Lease> held = leases.try_take("held");
  for (int i = 0; i < 3; ++i) leases.try_take("piece");
  hold_elsewhere(folder / "leases" / "gone.1", 1000000);
  leases.remove_left();
  EXPECT_FALSE(fs::exists(folder / "leases" / "piece.3"));
  EXPECT_FALSE(fs::exists(folder / "leases" / "gone.1"));
  EXPECT_FALSE(leases.try_take("held"));
  held.reset();
  leases.remove_left();
  EXPECT_FALSE(fs::exists(folder / "leases"));
}

/// A folder where processes note which pieces they did: one file per process, a line per piece.
class SharedWork : public ::testing::Test {
 protected:
  static constexpr std::size_t kPieces = 300;
  static std::vector<std::string> names() {
    std::vector<std::string> names;
    for (std::size_t i = 0; i < kPieces; ++i) names.push_back("piece" + std::to_string(i));
    return names;
  }
  fs::path result(std::size_t i) const { return folder_ / "results" / std::to_string(i); }

  void work(std::size_t process) const {
    const LeaseFolder leases(folder_ / "leases");
    std::ofstream notes(folder_ / ("notes" + std::to_string(process)));
    work_in_turn(
        leases, names(), [&](std::size_t i) { return fs::exists(result(i)); },
        [&](std::size_t i) {
          notes << i << std::endl;
          std::this_thread::sleep_for(300us);
          std::ofstream(result(i).string() + "." + std::to_string(process)) << "result " << i;
          fs::rename(result(i).string() + "." + std::to_string(process), result(i));
        });
  }

  std::map<std::size_t, int> done() const {
    std::map<std::size_t, int> times;
    for (const auto& entry : fs::directory_iterator(folder_.path())) {
      if (entry.path().filename().string().rfind("notes", 0) != 0) continue;
      std::ifstream notes(entry.path());
      for (std::size_t i; notes >> i;) ++times[i];
    }
    return times;
  }

  SharedWork() { fs::create_directories(folder_ / "results"); }
  test::TemporaryFolder folder_;
};

TEST_F(SharedWork, EveryPieceIsDoneExactlyOnceWhenNobodyDies) {
  std::vector<pid_t> children;
  for (std::size_t p = 0; p < 5; ++p) children.push_back(in_process([&] { work(p); }));
  for (const pid_t child : children) EXPECT_EQ(status_of(child), 0);
  const auto times = done();
  EXPECT_EQ(times.size(), kPieces);
  for (const auto& [piece, count] : times) EXPECT_EQ(count, 1) << piece;
}

TEST_F(SharedWork, AndAtLeastOnceWhenWorkersAreKilledAndOthersJoin) {
  std::vector<pid_t> doomed, children;
  for (std::size_t p = 0; p < 3; ++p) doomed.push_back(in_process([&] { work(p); }));
  children.push_back(in_process([&] { work(10); }));
  for (const pid_t child : doomed) {
    std::this_thread::sleep_for(15ms);
    ::kill(child, SIGKILL);
  }
  children.push_back(in_process([&] { work(11); }));
  for (const pid_t child : doomed) status_of(child);
  for (const pid_t child : children) EXPECT_EQ(status_of(child), 0);
  EXPECT_EQ(done().size(), kPieces);
  for (std::size_t i = 0; i < kPieces; ++i) EXPECT_EQ(read_file(result(i)), "result " + std::to_string(i));
}

TEST_F(SharedWork, AFailureIsNotTriedTwiceByTheSameProcess) {
  const LeaseFolder leases(folder_ / "leases");
  int tries = 0;
  work_in_turn(
      leases, {"a", "b"}, [](std::size_t) { return false; }, [&](std::size_t) { ++tries; });
  EXPECT_EQ(tries, 2);
}

TEST(ProcessIdentities, TellTheLivingFromTheDead) {
  EXPECT_FALSE(certainly_gone(this_process()));
  ProcessIdentity earlier = this_process();
  earlier.started += 1;
  EXPECT_TRUE(certainly_gone(earlier)) << "another process has its number now";
  earlier.space = "another machine";
  EXPECT_FALSE(certainly_gone(earlier));
  const std::string ours = process_number();
  const pid_t child = in_process([&] {
    if (process_number() == ours) throw std::runtime_error("a child has its parent's number");
  });
  EXPECT_EQ(status_of(child), 0);
  EXPECT_EQ(process_number(), ours);
  const ProcessIdentity again = process_identity_from_json(to_json(this_process()));
  EXPECT_EQ(again.started, this_process().started);
}

}  // namespace
}  // namespace anigen
