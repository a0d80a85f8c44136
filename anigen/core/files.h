#pragma once
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace anigen {

/// Makes a folder and those above it that are missing, so that they are still there after a power loss: the entry of
/// each is synced. @throws WriteError, Error as write_file_atomically()
void make_folders(const std::filesystem::path& folder);

/// Removes a file, or a folder with all that is in it, so that a power loss does not bring it back: the entry is
/// synced. For what describes other files, before those change. Nothing there is no error.
/// @throws WriteError, Error as write_file_atomically()
void remove_lastingly(const std::filesystem::path& path);

/// Moves a file into another folder of one file system under its own name, and syncs both folders. The folder is made
/// (make_folders()). @throws WriteError, Error as write_file_atomically()
void move_into_folder(const std::filesystem::path& file, const std::filesystem::path& folder);

/// Writes a file so that a reader, or a crash, never sees half of it: to `<path>.tmp-<process>-<n>`, fsync,
/// rename, fsync of the folder. Parent folders are made (make_folders()). Any number of machines may write to one
/// folder (process_number()). @throws WriteError naming the path when the disk refuses, Error when no file can have
/// that name.
void write_file_atomically(const std::filesystem::path& path, std::string_view bytes);

/// For writers that need a path of their own (images, zip archives): write to temporary(), then commit().
/// Destroyed without commit, it removes the temporary file.
class AtomicFile {
 public:
  explicit AtomicFile(std::filesystem::path target);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  /// Same extension as the target, so that libraries that choose a format by extension still do.
  const std::filesystem::path& temporary() const { return temporary_; }
  void commit();

 private:
  std::filesystem::path target_, temporary_;
  bool committed_ = false;
};

/// The whole file. @param max_bytes refuse larger ones before reading
/// @throws InputError when it is missing, unreadable or larger than max_bytes
std::string read_file(const std::filesystem::path& path, std::uintmax_t max_bytes = std::uintmax_t{8} << 30);

/// Refuses a command whose outputs would replace what it reads; called before any work. Paths name one file when the
/// file system says so, as std::filesystem::equivalent() compares: links and other spellings of a path count.
/// @param outputs those that are empty or do not exist replace nothing
/// @param inputs asked for only when one of the outputs exists @throws InputError naming the output and the input
void refuse_to_overwrite(const std::vector<std::filesystem::path>& outputs,
                         const std::function<std::vector<std::filesystem::path>()>& inputs);

}  // namespace anigen
