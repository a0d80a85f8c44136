#include "anigen/apps/common/torch_half.h"

#include <dlfcn.h>
#include <filesystem>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/parallel.h"

namespace anigen {

namespace {

namespace fs = std::filesystem;

constexpr const char* kModule = "anigen-torch.so";

fs::path find_module() {
  std::error_code error;
  const fs::path folder = fs::read_symlink("/proc/self/exe", error).parent_path();
  const fs::path installed = folder.parent_path() / "lib" / "anigen" / kModule;
  return fs::exists(installed, error) ? installed : folder / kModule;
}

const TorchHalf& load() {
  share_processors();
  const fs::path file = find_module();
  // Lazily: binding all of LibTorch's functions at once takes as long as reading its libraries. The module finds the
  // functions that the program has as well in the program, so that logging, progress and signals are one.
  void* module = ::dlopen(file.c_str(), RTLD_LAZY | RTLD_LOCAL);
  if (module == nullptr) throw Error("cannot load " + file.string() + ": " + ::dlerror());
  using Entry = const TorchHalf* (*)();
  const auto entry = reinterpret_cast<Entry>(::dlsym(module, "anigen_torch_half"));
  if (entry == nullptr) throw Error(file.string() + " is not of this program: " + ::dlerror());
  return *entry();
}

}  // namespace

const TorchHalf& torch_half(const std::string& what) {
#ifdef ANIGEN_WITH_TORCH
  static_cast<void>(what);
  static const TorchHalf& half = load();
  return half;
#else
  throw NotSupportedError("", "", what + " in a build without LibTorch");
#endif
}

}  // namespace anigen
