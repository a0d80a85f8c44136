#include "tests/support/paths.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <cstring>
#include <sstream>
#include <stdexcept>
#include <system_error>

namespace anigen::test {
namespace {

namespace fs = std::filesystem;

fs::path from_environment(const char* variable, const char* beside_checkout) {
  const char* value = std::getenv(variable);
  if (value != nullptr && *value != '\0') return value;
  return fs::path(ANIGEN_SOURCE_DIR).parent_path() / "shared" / beside_checkout;
}

// Adds a failure to every test that was skipped for lack of something.
class SkipsAreFailures : public ::testing::EmptyTestEventListener {
  void OnTestEnd(const ::testing::TestInfo& test) override {
    if (!test.result()->Skipped() || !fixtures_are_required()) return;
    for (int i = 0; i < test.result()->total_part_count(); ++i) {
      const ::testing::TestPartResult& part = test.result()->GetTestPartResult(i);
      if (part.skipped() && std::strstr(part.message(), "not supported: ") != nullptr) return;
    }
    ADD_FAILURE() << "skipped, although ANIGEN_REQUIRE_FIXTURES=1 asks for every fixture and asset";
  }
};

const bool kListens = [] {
  ::testing::UnitTest::GetInstance()->listeners().Append(new SkipsAreFailures);  // which owns it
  return true;
}();

}  // namespace

fs::path source_dir() { return ANIGEN_SOURCE_DIR; }

std::vector<fs::path> parity_dirs() {
  const char* value = std::getenv("ANIGEN_PARITY_DIR");
  if (value == nullptr || *value == '\0') {
    return {fs::path(ANIGEN_SOURCE_DIR).parent_path() / "shared" / "parity",
            source_dir() / "tests" / "data" / "parity"};
  }
  std::vector<fs::path> folders;
  std::istringstream list(value);
  for (std::string folder; std::getline(list, folder, ':');) {
    if (!folder.empty()) folders.emplace_back(folder);
  }
  return folders;
}

fs::path parity_file(const fs::path& relative) {
  const std::vector<fs::path> folders = parity_dirs();
  for (const fs::path& folder : folders) {
    if (fs::exists(folder / relative)) return folder / relative;
  }
  return folders.empty() ? relative : folders.front() / relative;
}

bool fixtures_are_required() {
  const char* value = std::getenv("ANIGEN_REQUIRE_FIXTURES");
  return value != nullptr && std::strcmp(value, "1") == 0;
}

fs::path assets_dir() { return from_environment("ANIGEN_ASSETS_DIR", "assets"); }

TemporaryFolder::TemporaryFolder() {
  std::string pattern = (fs::temp_directory_path() / "anigen-test-XXXXXX").string();
  if (::mkdtemp(pattern.data()) == nullptr) throw std::runtime_error("cannot create a temporary folder");
  path_ = pattern;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ignored;
  fs::remove_all(path_, ignored);
}

}  // namespace anigen::test
