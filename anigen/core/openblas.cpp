#include "anigen/core/openblas.h"

#include <dlfcn.h>
#include <unistd.h>
#include <cstdlib>
#include <initializer_list>

namespace anigen {

namespace {

constexpr const char* kVariable = "OPENBLAS_CORETYPE";

bool is_one_of(const std::string& name, std::initializer_list<const char*> names) {
  for (const char* other : names) {
    if (name == other) return true;
  }
  return false;
}

}  // namespace

std::string openblas_core() {
#if defined(__x86_64__) && defined(__GNUC__)
  if (__builtin_cpu_supports("avx2") == 0 || __builtin_cpu_supports("fma") == 0) return "";
  const bool avx512 = __builtin_cpu_supports("avx512f") != 0 && __builtin_cpu_supports("avx512cd") != 0 &&
                      __builtin_cpu_supports("avx512bw") != 0 && __builtin_cpu_supports("avx512dq") != 0 &&
                      __builtin_cpu_supports("avx512vl") != 0;
  // AMD's with AVX-512, too: 0.3.21 has no kernels of their own for them, and takes those for AVX2.
  if (avx512) return "SkylakeX";
  return __builtin_cpu_is("amd") != 0 ? "Zen" : "Haswell";
#else
  return "";
#endif
}

std::string loaded_openblas_core() {
  using CoreName = char* (*)();
  const auto name = reinterpret_cast<CoreName>(::dlsym(RTLD_DEFAULT, "openblas_get_corename"));
  return name == nullptr ? "" : name();
}

bool openblas_is_slow() {
  const std::string wanted = openblas_core(), loaded = loaded_openblas_core();
  const char* asked = std::getenv(kVariable);
  if (asked != nullptr && wanted != asked) return false;
  if (wanted.empty() || loaded.empty() || is_one_of(loaded, {"SkylakeX", "Cooperlake", "SapphireRapids"})) return false;
  return wanted == "SkylakeX" || !is_one_of(loaded, {"Haswell", "Zen"});
}

void name_openblas_core() {
  const std::string core = openblas_core();
  if (!core.empty()) ::setenv(kVariable, core.c_str(), /*overwrite=*/0);
}

void start_with_openblas_core(char** argv) {
  if (std::getenv(kVariable) != nullptr) return;  // also of the program that this one was before
  name_openblas_core();
  if (openblas_is_slow()) ::execv("/proc/self/exe", argv);
}

std::string openblas_details() {
  const char* value = std::getenv(kVariable);
  const std::string core = value == nullptr ? openblas_core() : value;
  return "OpenBLAS core " + (core.empty() ? "of its own choice" : core);
}

}  // namespace anigen
