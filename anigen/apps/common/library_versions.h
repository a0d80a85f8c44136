#pragma once
#include <functional>
#include <string>

#include "anigen/apps/common/torch_half.h"

namespace anigen {

/// Lines that --version adds: libraries of the half that needs LibTorch, which is loaded for them.
inline std::function<std::string()> library_versions() {
#ifdef ANIGEN_WITH_TORCH
  return [] { return torch_half("--version").version_details(); };
#else
  return {};
#endif
}

}  // namespace anigen
