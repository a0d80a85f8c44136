#pragma once
#include <filesystem>
#include <string>

namespace anigen {

/// A new folder for temporary files that only this user can enter; it goes away with what is in it.
class PrivateFolder {
 public:
  /// @throws WriteError when there is no place for it
  PrivateFolder();
  ~PrivateFolder();
  PrivateFolder(const PrivateFolder&) = delete;
  PrivateFolder& operator=(const PrivateFolder&) = delete;

  const std::string& path() const { return path_; }
  std::filesystem::path operator/(const std::string& name) const { return std::filesystem::path(path_) / name; }

 private:
  std::string path_;
};

}  // namespace anigen
