#include "anigen/core/private_folder.h"

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <system_error>

#include "anigen/core/error.h"

namespace anigen {

PrivateFolder::PrivateFolder() : path_((std::filesystem::temp_directory_path() / "anigen-XXXXXX").string()) {
  if (::mkdtemp(path_.data()) == nullptr)
    throw WriteError(path_ + ": cannot create a temporary folder: " + std::strerror(errno));
}

PrivateFolder::~PrivateFolder() {
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
}

}  // namespace anigen
