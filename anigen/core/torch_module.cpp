#include "anigen/core/torch_module.h"

#include <dlfcn.h>
#include <filesystem>
#include <string>
#include <system_error>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/openblas.h"
#include "anigen/core/parallel.h"

namespace anigen {

namespace {

namespace fs = std::filesystem;

constexpr const char* kModule = "anigen-torch.so";

/// File of the library or program that this code is in, as it was opened.
fs::path own_library() {
  Dl_info self{};
  if (::dladdr(reinterpret_cast<void*>(&torch_module_entry), &self) == 0 || self.dli_fname == nullptr) return {};
  return self.dli_fname;
}

fs::path find_module() {
  std::error_code error;
  std::vector<fs::path> folders;
  const fs::path library = own_library();
  if (!library.empty()) folders.push_back(fs::canonical(library, error).parent_path());
  folders.push_back(fs::read_symlink("/proc/self/exe", error).parent_path());
  for (const fs::path& folder : folders) {
    if (folder.empty()) continue;
    for (const fs::path& place : {folder.parent_path() / "lib" / "anigen", folder / "anigen", folder}) {
      if (fs::exists(place / kModule, error)) return place / kModule;
    }
  }
  return folders.back() / kModule;
}

struct Module {
  fs::path file;
  void* handle = nullptr;
};

Module load() {
  share_processors();
  name_openblas_core();
  Module module;
  module.file = find_module();
  // Lazily: binding all of LibTorch's functions at once takes as long as reading its libraries. The module finds the
  // functions that the program or libanigen.so has as well there, so that logging, progress and signals are one; those
  // of a library count only once it is global, which one that came with a Python module is not.
  ::dlopen(own_library().c_str(), RTLD_LAZY | RTLD_GLOBAL | RTLD_NOLOAD);
  module.handle = ::dlopen(module.file.c_str(), RTLD_LAZY | RTLD_LOCAL);
  if (module.handle == nullptr) throw Error("cannot load " + module.file.string() + ": " + ::dlerror());
  return module;
}

}  // namespace

void* torch_module_entry(const char* function) {
  static const Module module = load();
  void* entry = ::dlsym(module.handle, function);
  if (entry == nullptr) throw Error(module.file.string() + " is not of this program: " + ::dlerror());
  return entry;
}

}  // namespace anigen
