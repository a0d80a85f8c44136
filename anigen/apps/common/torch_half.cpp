#include "anigen/apps/common/torch_half.h"

#include "anigen/core/error.h"
#include "anigen/core/torch_module.h"

namespace anigen {

const TorchHalf& torch_half(const std::string& what) {
#ifdef ANIGEN_WITH_TORCH
  static_cast<void>(what);
  using Entry = const TorchHalf* (*)();
  static const TorchHalf& half = *reinterpret_cast<Entry>(torch_module_entry("anigen_torch_half"))();
  return half;
#else
  throw NotSupportedError("", "", what + " in a build without LibTorch");
#endif
}

}  // namespace anigen
