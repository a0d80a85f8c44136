#include "anigen/core/openblas.h"

#include <cstdlib>

namespace anigen {

namespace {

constexpr const char* kVariable = "OPENBLAS_CORETYPE";

}  // namespace

std::string openblas_core() {
#if defined(__x86_64__) && defined(__GNUC__)
  if (__builtin_cpu_supports("avx2") == 0 || __builtin_cpu_supports("fma") == 0) return "";
  if (__builtin_cpu_is("amd") != 0) return "Zen";
  const bool avx512 = __builtin_cpu_supports("avx512f") != 0 && __builtin_cpu_supports("avx512cd") != 0 &&
                      __builtin_cpu_supports("avx512bw") != 0 && __builtin_cpu_supports("avx512dq") != 0 &&
                      __builtin_cpu_supports("avx512vl") != 0;
  return avx512 ? "SkylakeX" : "Haswell";
#else
  return "";
#endif
}

void name_openblas_core() {
  const std::string core = openblas_core();
  if (!core.empty()) ::setenv(kVariable, core.c_str(), /*overwrite=*/0);
}

std::string openblas_details() {
  const char* value = std::getenv(kVariable);
  const std::string core = value == nullptr ? openblas_core() : value;
  return "OpenBLAS core " + (core.empty() ? "of its own choice" : core);
}

}  // namespace anigen
