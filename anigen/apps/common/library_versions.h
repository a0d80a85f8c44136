#pragma once
#include <functional>
#include <string>
#ifdef ANIGEN_WITH_TORCH
#include "anigen/nn/blas.h"
#endif

namespace anigen {

/// What --version adds in a program that can also be built without LibTorch.
inline std::function<std::string()> library_versions() {
#ifdef ANIGEN_WITH_TORCH
  return nn::version_details;
#else
  return {};
#endif
}

}  // namespace anigen
