#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace anigen::test {

/// Folders of parity fixtures: those that ANIGEN_PARITY_DIR names, one or several with colons between them, else
/// ../shared/parity beside the checkout and tests/data/parity in it. A fixture of several folders is taken from the
/// first. They may not exist: tests then skip.
std::vector<std::filesystem::path> parity_dirs();
/// A file or folder in the first of parity_dirs() that has it; where none has, a path in the first that does not exist.
std::filesystem::path parity_file(const std::filesystem::path& relative);
/// True if ANIGEN_REQUIRE_FIXTURES is 1: a test that lacks a fixture or an asset then fails instead of being skipped.
/// Every program that calls a function of this header does so for all of its GoogleTest tests, but for those that skip
/// with the words "not supported: ".
bool fixtures_are_required();
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
