#pragma once
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <utility>

#include "anigen/core/config.h"

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

bool interrupt_requested();

/// @throws Interrupted when the flag is up. Call where everything worth keeping has been saved.
void throw_if_interrupted();

/// Limits of a guarded process; past one of them it is ended.
struct ProcessLimits {
  double cpu_seconds = 60.0;
  std::uint64_t more_memory =
      0;  ///< bytes of address space beyond what this process has; 0: as much as the machine has
};

/// Outcome of guarded work.
struct GuardedWork {
  bool finished = false;
  std::string result;   ///< what the work returned, when it finished
  std::string failure;  ///< else in words that follow "it ": "crashed (Segmentation fault)", "took more than 60 s …"
};

/// Runs work that may crash, hang or fill the memory, such as a library that parses a foreign file, in a copy of this
/// process (fork), so that this one goes on whatever happens. The copy has the calling thread alone: the work must not
/// wait for others, and so use neither parallel_for nor the log. What it changes in memory stays in the copy. An
/// exception that leaves it counts as a crash. The copy ends with its parent.
/// @throws Error when the system refuses a process
GuardedWork run_guarded(const std::function<std::string()>& work, const ProcessLimits& limits);

}  // namespace anigen
