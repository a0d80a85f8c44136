#include "anigen/io/opencv_module.h"

#include <dlfcn.h>
#include <filesystem>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/module_file.h"

namespace anigen::io {

namespace {

struct OpenCvModule {
  std::filesystem::path file;
  void* handle = nullptr;
};

OpenCvModule load_opencv() {
  OpenCvModule module;
  module.file = find_module("anigen-opencv.so");
  std::error_code error;
  if (std::filesystem::exists(module.file, error)) module.handle = load_module(module.file);
  return module;
}

}  // namespace

void* opencv_module_entry(const char* function) {
  static const OpenCvModule module = load_opencv();
  if (module.handle == nullptr) return nullptr;
  void* entry = ::dlsym(module.handle, function);
  if (entry == nullptr) throw Error(module.file.string() + " is not of this program: " + ::dlerror());
  return entry;
}

}  // namespace anigen::io
