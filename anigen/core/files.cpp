#include "anigen/core/files.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <map>
#include <optional>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/process.h"

namespace anigen {

namespace {

namespace fs = std::filesystem;

[[noreturn]] void fail(const fs::path& path, const char* action, int reason = errno) {
  const std::string text = path.string() + ": cannot " + action + ": " + std::strerror(reason);
  // A name that no file can have concerns one file; everything else concerns the disk.
  for (const int of_name : {ENAMETOOLONG, ENOTDIR, EISDIR, EEXIST, ENOTEMPTY, EINVAL}) {
    if (reason == of_name) throw Error(text);
  }
  throw WriteError(text);
}

void flush_to_disk(const fs::path& path, int flags) {
  const int descriptor = ::open(path.c_str(), flags);
  if (descriptor < 0) fail(path, "open");
  const int result = ::fsync(descriptor);
  ::close(descriptor);
  // Some file systems cannot sync folders (EINVAL); the rename is still atomic there.
  if (result != 0 && errno != EINVAL) fail(path, "fsync");
}

fs::path temporary_beside(const fs::path& target) {
  static std::atomic<unsigned> counter{0};
  // Not the process id alone: two machines, or two containers, may write to one folder under the same one.
  const std::string mark = ".tmp-" + process_number() + "-" + std::to_string(counter++);
  return target.parent_path() / (target.stem().string() + mark + target.extension().string());
}

/// The folder that holds an entry.
fs::path folder_of(const fs::path& entry) { return entry.has_parent_path() ? entry.parent_path() : fs::path("."); }

using FileNumber = std::pair<dev_t, ino_t>;

/// Tells files apart as std::filesystem::equivalent() does; nothing when there is no such file.
std::optional<FileNumber> number_of(const fs::path& file) {
  struct stat status {};
  if (::stat(file.c_str(), &status) != 0) return std::nullopt;
  return FileNumber(status.st_dev, status.st_ino);
}

}  // namespace

void make_folders(const fs::path& folder) {
  if (folder.empty()) return;  // of a name without a folder
  std::vector<fs::path> missing;
  std::error_code error;
  for (fs::path at = folder; !at.empty() && !fs::exists(at, error); at = at.parent_path()) missing.push_back(at);
  if (missing.empty() && fs::is_directory(folder, error)) return;
  fs::create_directories(folder, error);
  if (error) fail(folder, "create folder", error.value());
  for (const fs::path& made : missing) {
    const fs::path above = folder_of(made);
    // One that we may write to and not read cannot be synced.
    if (::access(above.c_str(), R_OK) == 0) flush_to_disk(above, O_RDONLY | O_DIRECTORY);
  }
}

void remove_lastingly(const fs::path& path) {
  std::error_code error;
  if (fs::remove_all(path, error) == 0 && !error) return;
  if (error) fail(path, "remove", error.value());
  flush_to_disk(folder_of(path), O_RDONLY | O_DIRECTORY);
}

void move_into_folder(const fs::path& file, const fs::path& folder) {
  make_folders(folder);
  const fs::path target = folder / file.filename();
  if (::rename(file.c_str(), target.c_str()) != 0) fail(file, ("move to " + folder.string()).c_str());
  // The new name first: a loss between the two leaves two names of one file rather than none.
  flush_to_disk(folder, O_RDONLY | O_DIRECTORY);
  flush_to_disk(folder_of(file), O_RDONLY | O_DIRECTORY);
}

AtomicFile::AtomicFile(fs::path target) : target_(std::move(target)), temporary_(temporary_beside(target_)) {
  make_folders(target_.parent_path());
}

AtomicFile::~AtomicFile() {
  if (committed_) return;
  std::error_code ignored;
  fs::remove(temporary_, ignored);
}

void AtomicFile::commit() {
  flush_to_disk(temporary_, O_RDONLY);
  if (::rename(temporary_.c_str(), target_.c_str()) != 0) fail(target_, "rename into place");
  committed_ = true;
  flush_to_disk(folder_of(target_), O_RDONLY | O_DIRECTORY);
}

void write_file_atomically(const fs::path& path, std::string_view bytes) {
  AtomicFile file(path);
  {
    std::ofstream out(file.temporary(), std::ios::binary);
    out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    out.flush();
    if (!out) fail(file.temporary(), "write");
  }
  file.commit();
}

std::string read_file(const fs::path& path, std::uintmax_t max_bytes) {
  std::error_code error;
  if (!fs::exists(path, error)) throw InputError(path.string(), "", "no such file");
  if (!fs::is_regular_file(path, error)) throw InputError(path.string(), "", "not a regular file");
  const std::uintmax_t size = fs::file_size(path, error);
  if (error) throw InputError(path.string(), "", "cannot read its size: " + error.message());
  if (size > max_bytes) {
    throw InputError(
        path.string(), "",
        "file of " + std::to_string(size) + " bytes exceeds the limit of " + std::to_string(max_bytes) + " bytes");
  }
  std::ifstream in(path, std::ios::binary);
  if (!in) throw InputError(path.string(), "", std::string("cannot open: ") + std::strerror(errno));
  std::string bytes(static_cast<std::size_t>(size), '\0');
  in.read(bytes.data(), static_cast<std::streamsize>(size));
  if (static_cast<std::uintmax_t>(in.gcount()) != size)
    throw InputError(path.string(), "", "file shrank while it was read");
  return bytes;
}

void refuse_to_overwrite(const std::vector<fs::path>& outputs, const std::function<std::vector<fs::path>()>& inputs) {
  std::map<FileNumber, fs::path> there;
  for (const fs::path& output : outputs) {
    if (const std::optional<FileNumber> number = number_of(output)) there.emplace(*number, output);
  }
  if (there.empty()) return;
  for (const fs::path& input : inputs()) {
    const std::optional<FileNumber> number = number_of(input);
    const auto found = number ? there.find(*number) : there.end();
    if (found == there.end()) continue;
    const std::string read = found->second == input ? "an input" : "the input " + input.string();
    throw InputError(found->second.string(), "",
                     "is " + read + ", which the result would replace: name another output; nothing was changed");
  }
}

}  // namespace anigen
