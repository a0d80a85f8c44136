#pragma once
#include <cstdint>
#include <filesystem>
#include <vector>

namespace anigen {

/// Rights that a process keeps. All others are given up for good, by it and by every process it starts: opening
/// sockets, running programs, tracing and signalling other processes, mounting, changing owners and modes of files,
/// everything that only an administrator needs. Reading files, memory and threads stay.
struct SandboxRights {
  /// Folders in which files and folders are made, changed and removed. Empty: nowhere, and no file is opened for
  /// writing
  std::vector<std::filesystem::path> writable;
  bool processes = false;        ///< may start copies of itself (fork), and signal them
  std::uint64_t file_bytes = 0;  ///< most that a file it writes may have
  int more_files = 64;           ///< files that it may open at once, beside those that are open
};

/// Means that a kernel offers, or that hold a process.
struct SandboxMeans {
  bool calls = false;    ///< seccomp filters: system calls are refused
  bool folders = false;  ///< Landlock: files change in `writable` alone; without it that holds only when it is empty
};

/// Of this machine. A container may withhold what its kernel has.
SandboxMeans sandbox_means();

/// Gives up all rights but those. A call that is refused fails like any other call, with EPERM or EACCES ("Operation
/// not permitted", "Permission denied"), and so becomes the error of the one who made it; a file that grows too large
/// fails with EFBIG. Descriptors that are open stay usable. Call it before there are other threads: their folders would
/// not be held. @return the means that hold; a process goes on without those that its kernel lacks
/// @throws Error when a writable folder cannot be opened
SandboxMeans enter_sandbox(const SandboxRights& rights);

}  // namespace anigen
