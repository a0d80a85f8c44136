#include "anigen/core/torch_module.h"

#include <dlfcn.h>
#include <filesystem>

#include "anigen/core/error.h"
#include "anigen/core/module_file.h"
#include "anigen/core/openblas.h"
#include "anigen/core/parallel.h"

namespace anigen {

namespace {

struct Module {
  std::filesystem::path file;
  void* handle = nullptr;
};

Module load() {
  share_processors();
  name_openblas_core();
  Module module;
  module.file = find_module("anigen-torch.so");
  module.handle = load_module(module.file);
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
