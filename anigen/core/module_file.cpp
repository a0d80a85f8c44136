#include "anigen/core/module_file.h"

#include <dlfcn.h>
#include <system_error>
#include <vector>

#include "anigen/core/error.h"

namespace anigen {

namespace {

namespace fs = std::filesystem;

/// File of the library or program that this code is in, as it was opened.
fs::path own_library() {
  Dl_info self{};
  if (::dladdr(reinterpret_cast<void*>(&load_module), &self) == 0 || self.dli_fname == nullptr) return {};
  return self.dli_fname;
}

}  // namespace

fs::path find_module(const std::string& name) {
  std::error_code error;
  std::vector<fs::path> folders;
  const fs::path library = own_library();
  if (!library.empty()) folders.push_back(fs::canonical(library, error).parent_path());
  folders.push_back(fs::read_symlink("/proc/self/exe", error).parent_path());
  for (const fs::path& folder : folders) {
    if (folder.empty()) continue;
    const fs::path above = folder.parent_path();
    for (const fs::path& place :
         {above / "lib" / "anigen", folder / "anigen", folder, above.parent_path() / "lib" / "anigen"}) {
      if (fs::exists(place / name, error)) return place / name;
    }
  }
  return folders.back() / name;
}

void* load_module(const fs::path& file) {
  // Lazily: binding all of LibTorch's functions at once takes as long as reading its libraries. Functions of a library
  // count for others only once it is global, which one that came with a Python module is not.
  ::dlopen(own_library().c_str(), RTLD_LAZY | RTLD_GLOBAL | RTLD_NOLOAD);
  void* handle = ::dlopen(file.c_str(), RTLD_LAZY | RTLD_LOCAL);
  if (handle == nullptr) throw Error("cannot load " + file.string() + ": " + ::dlerror());
  return handle;
}

}  // namespace anigen
