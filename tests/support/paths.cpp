#include "tests/support/paths.h"

#include <cstdlib>
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

}  // namespace

fs::path source_dir() { return ANIGEN_SOURCE_DIR; }

fs::path parity_dir() { return from_environment("ANIGEN_PARITY_DIR", "parity"); }

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
