#include "anigen/io/opencv_module.h"

#include <dlfcn.h>
#include <filesystem>
#include <system_error>

#include "anigen/core/error.h"
#include "anigen/core/log.h"
#include "anigen/core/module_file.h"

namespace anigen::io {

#ifdef ANIGEN_LEAN

// Whatever lies beside a lean program is not of its build.
void* opencv_module_entry(const char* /*function*/) { return nullptr; }

#else

namespace {

struct OpenCvModule {
  std::filesystem::path file;
  void* handle = nullptr;
};

OpenCvModule load_opencv() {
  OpenCvModule module;
  module.file = find_module("anigen-opencv.so");
  std::error_code error;
  if (std::filesystem::exists(module.file, error)) {
    module.handle = load_module(module.file);
  } else {
    log::warn("{} is not there: no WebP and TIFF pictures, JPEG by another decoder, coarse captions",
              module.file.string());
  }
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

#endif

}  // namespace anigen::io
