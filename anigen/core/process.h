#pragma once
#include <sys/types.h>
#include <csignal>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/core/sandbox.h"

namespace anigen {

/// Identity of a process, for files that several machines and containers share, where a process id alone means nothing.
struct ProcessIdentity {
  std::string host;           ///< for people
  std::string space;          ///< boot of the machine and process-id namespace: where `id` means something
  std::int64_t id = 0;        ///< process id
  std::uint64_t started = 0;  ///< in clock ticks since boot, which tells it from an earlier process of this id
};

ProcessIdentity this_process();

/// The process was in this machine's process-id namespace, and is not there any more; a zombie counts as gone. False
/// also where that cannot be told.
bool certainly_gone(const ProcessIdentity& process);

/// Identity of this process's loopback network: boot of the machine and network namespace, the same for processes that
/// reach each other at 127.0.0.1; the name of the host where the system does not say.
std::string network_space();

/// A number for names of temporary files, different for every process that could write to the same folder. Decimal.
std::string process_number();

Json to_json(const ProcessIdentity& process);
/// @throws Json::exception when it is not what to_json() writes
ProcessIdentity process_identity_from_json(const Json& json);

/// An advisory lock on a file (flock), which is created with its folder when it is not there. The kernel lets go of it
/// however the process ends, so no stale lock stays behind. Programs that are started do not inherit it.
class FileLock {
 public:
  enum class Kind { kShared, kExclusive };

  /// Does not wait. @return nothing when somebody else holds it @throws NotSupportedError when the file system has no
  /// locks; Error when the file cannot be opened or locked
  static std::optional<FileLock> try_lock(const std::filesystem::path& file, Kind kind);

  FileLock(FileLock&& other) noexcept : descriptor_(std::exchange(other.descriptor_, -1)) {}
  FileLock& operator=(FileLock&& other) noexcept {
    std::swap(descriptor_, other.descriptor_);
    return *this;
  }
  ~FileLock();

 private:
  explicit FileLock(int descriptor) : descriptor_(descriptor) {}
  int descriptor_;
};

/// Lock shared by programs that add to a dataset, such as anigen-encode: `<root>/run/lock`.
std::filesystem::path dataset_lock_file(const std::filesystem::path& root);

/// Lock shared by programs that make a dataset: `<root>/run/lock-prepare`. Each of the two kinds keeps
/// the other out.
std::filesystem::path dataset_prepare_lock_file(const std::filesystem::path& root);

/// Waits until it has the lock. For locks that nobody holds for long. @throws Interrupted after Ctrl-C
FileLock wait_for_lock(const std::filesystem::path& file, FileLock::Kind kind);

/// Makes this process one of those that work on the same thing, as long as the lock lives. Who joins passes a gate one
/// at a time (`<file>-gate`), so that there is exactly one first.
/// @param file that all members hold together
/// @param enter is called in the gate, before this process is a member; `first` when there is no other one. What it
/// throws keeps this process out
/// @return nothing when somebody has the place to itself
std::optional<FileLock> join_group(const std::filesystem::path& file, const std::function<void(bool first)>& enter);

/// Has the place of a group to itself, as long as the lock lives. @return nothing while the group has members
std::optional<FileLock> instead_of_group(const std::filesystem::path& file);

/// Calls `action` in the gate, so that nobody joins meanwhile. @return false, without calling it, when there are
/// members
bool while_group_is_empty(const std::filesystem::path& file, const std::function<void()>& action);

/// From now on SIGINT and SIGTERM only raise a flag that long work polls; a second signal ends the process at once.
void install_interrupt_handler();

/// The flag is up, or this thread's job (core/job.h) was cancelled.
bool interrupt_requested();

/// @throws Interrupted when interrupt_requested(). Call where everything worth keeping has been saved.
void throw_if_interrupted();

/// A program to be started.
struct ChildProgram {
  std::vector<std::string> words;        ///< the program's file, then its arguments
  std::string file;                      ///< what to run instead of words[0], which stays its name
  std::vector<std::string> environment;  ///< NAME=value, beside this process's own variables and before them
  std::filesystem::path log;  ///< its output and errors are appended here, and its input is empty; unset: as ours
  bool pipes = false;         ///< its input and output are pipes to us
  /// In a process group of its own, so that Ctrl-C in a terminal reaches us alone; else it starts with SIGINT ignored.
  bool own_group = true;
  /// Sent when this process ends, however it does (Linux PR_SET_PDEATHSIG), and when a ChildProcess is destroyed.
  int last_signal = SIGTERM;
};

/// A program that was started. It inherits no open file but its standard ones. Start it from the main thread: the
/// kernel ties it to the thread that did.
class ChildProcess {
 public:
  struct End {
    int status = 0;                ///< exit status; -N: ended by signal N
    std::uint64_t peak_bytes = 0;  ///< most memory of it, or of a process it waited for
  };

  /// @throws Error when the system refuses; a program that cannot be run says so and ends with status 127
  explicit ChildProcess(const ChildProgram& program);
  /// One that fork() made. @param last_signal as in ChildProgram
  ChildProcess(pid_t id, int last_signal) : id_(id), last_signal_(last_signal) {}
  ChildProcess(ChildProcess&& other) noexcept;
  ChildProcess& operator=(ChildProcess&&) = delete;
  ~ChildProcess();  ///< sends the last signal, and waits

  pid_t id() const { return id_; }        ///< -1 after its end was seen
  int input() const { return input_; }    ///< writes to its standard input; -1 without pipes
  int output() const { return output_; }  ///< reads from its standard output, without waiting; -1 without pipes
  /// @return nothing while it still runs, and after its end was returned @throws Error when the system has lost it
  std::optional<End> poll();
  void send(int signal) const;
  /// SIGTERM, once: a second one would end a program of ours before it has saved.
  void ask_to_stop();

 private:
  pid_t id_ = -1;
  int input_ = -1, output_ = -1, last_signal_;
  bool asked_ = false;
};

/// Limits of a guarded process; past one of them it is ended.
struct ProcessLimits {
  double cpu_seconds = 60.0;
  std::uint64_t more_memory =
      0;  ///< bytes of address space beyond this process's, and of a result; 0: as much as the machine has
  /// Rights that it keeps; nothing: all of this process's, with the files that are open in it.
  std::optional<SandboxRights> sandbox = {};
  /// Called here many times a second while the work runs, to show progress; the work is ended by what it throws.
  std::function<void()> while_waiting = {};
};

/// Outcome of guarded work.
struct GuardedWork {
  bool finished = false;
  std::string result;   ///< what the work returned, when it finished
  std::string failure;  ///< else in words that follow "it ": "crashed (Segmentation fault)", "took more than 60 s …"
};

/// Runs work that may crash, hang or fill the memory, such as a library that parses a foreign file, in a copy of this
/// process (fork). The copy has the calling thread alone: the work must not wait for others, and so use neither
/// parallel_for nor the log. What it changes in memory stays in the copy; one that sleeps for 2 s without working, as
/// for a lock of another thread, is replaced, twice at most. An exception counts as a crash. It ends with its parent.
/// @throws Error when the system refuses a process
GuardedWork run_guarded(const std::function<std::string()>& work, const ProcessLimits& limits);

}  // namespace anigen
