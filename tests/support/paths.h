#pragma once
#include <filesystem>
#include <string>

namespace anigen::test {

/// ANIGEN_PARITY_DIR, else ../shared/parity beside the checkout. May not exist: tests then skip.
std::filesystem::path parity_dir();
/// The checkout.
std::filesystem::path source_dir();
/// ANIGEN_ASSETS_DIR, else ../shared/assets beside the checkout. May not exist: tests then skip.
std::filesystem::path assets_dir();

/// A folder of its own for one test, removed at the end.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path operator/(const std::string& name) const { return path_ / name; }

 private:
  std::filesystem::path path_;
};

}  // namespace anigen::test
