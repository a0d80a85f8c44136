#include "anigen/io/rigs/file_list.h"

#include <algorithm>
#include <cctype>
#include <fstream>
#include <set>
#include <utility>

#include "anigen/core/error.h"

namespace anigen::io {

namespace fs = std::filesystem;

FileListSource::FileListSource(std::vector<Entry> entries, Reader reader, std::string description, bool single)
    : entries_(std::move(entries)), reader_(std::move(reader)), description_(std::move(description)), single_(single) {
  for (const Entry& entry : entries_) {
    const auto [there, is_new] = files_.try_emplace(entry.id, entry.file);
    if (!is_new) {
      throw InputError(entry.file.string(), "",
                       "its id \"" + entry.id + "\" is also that of " + there->second.string() + "; keep one of them");
    }
  }
}

std::vector<std::string> FileListSource::ids() const {
  std::vector<std::string> result;
  for (const Entry& entry : entries_) result.push_back(entry.id);
  return result;
}

const fs::path& FileListSource::file(const std::string& id) const {
  const auto found = files_.find(id);
  if (found == files_.end()) throw InputError(description_, "", "there is no \"" + id + "\"");
  return found->second;
}

RiggedShape FileListSource::read(const std::string& id) const {
  require_content(file(id));
  return reader_(file(id), id);
}

std::vector<std::string> FileListSource::other_names(const std::string& id) const {
  std::string name = file(id).stem().string();
  if (name == fs::path(id).filename().string()) return {};
  return {std::move(name)};
}

std::string lower_extension(const fs::path& file) {
  std::string extension = file.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return extension;
}

std::vector<fs::path> files_below(const fs::path& folder, const std::vector<std::string>& extensions) {
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::recursive_directory_iterator it(folder, fs::directory_options::skip_permission_denied, error), end;
       !error && it != end; it.increment(error)) {
    std::error_code unreadable;
    const std::string extension = lower_extension(it->path());
    if (std::find(extensions.begin(), extensions.end(), extension) == extensions.end()) continue;
    if (it->is_regular_file(unreadable)) files.push_back(it->path());
  }
  if (error) throw InputError(folder.string(), "", "cannot be listed: " + error.message());
  std::sort(files.begin(), files.end());
  return files;
}

std::vector<FileListSource::Entry> entries_below(const fs::path& folder, const std::vector<fs::path>& files) {
  std::set<fs::path> parents;
  for (const fs::path& file : files) parents.insert(file.parent_path().lexically_relative(folder));
  const bool alone = parents.size() == files.size() && parents.count(fs::path(".")) == 0;
  std::vector<FileListSource::Entry> entries;
  for (const fs::path& file : files) {
    const fs::path below = file.lexically_relative(folder);
    const fs::path id = alone ? below.parent_path() : below.parent_path() / below.stem();
    entries.push_back({id.generic_string(), file});
  }
  return entries;
}

void require_content(const fs::path& file) {
  std::error_code error;
  const fs::file_status status = fs::status(file, error);
  if (!fs::exists(status)) throw InputError(file.string(), "", "there is no such file");
  if (!fs::is_regular_file(status)) throw InputError(file.string(), "", "is not a file");
  constexpr std::string_view kPointer = "version https://git-lfs.github.com/spec/";
  std::string start(kPointer.size(), '\0');
  std::ifstream in(file, std::ios::binary);
  if (!in) throw InputError(file.string(), "", "cannot be read");
  in.read(start.data(), static_cast<std::streamsize>(start.size()));
  start.resize(static_cast<std::size_t>(in.gcount()));
  if (start.empty()) throw InputError(file.string(), "byte 0", "the file is empty");
  if (start == kPointer)
    throw InputError(file.string(), "", "is a Git LFS pointer, not the file itself; fetch it with: git lfs pull");
}

}  // namespace anigen::io
