#pragma once
#include <filesystem>
#include <optional>
#include <utility>

namespace anigen {

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

/// What programs that add to a dataset, such as anigen-encode, lock together: `<root>/run/lock`.
std::filesystem::path dataset_lock_file(const std::filesystem::path& root);

/// What those that make a dataset lock together (group_lock.h): `<root>/run/lock-prepare`. Each of the two kinds keeps
/// the other out.
std::filesystem::path dataset_prepare_lock_file(const std::filesystem::path& root);

}  // namespace anigen
