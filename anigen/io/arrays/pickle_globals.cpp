#include <array>

#include "anigen/io/arrays/pickle_constructors.h"

namespace anigen::io::pickle {
namespace {

struct Entry {
  std::string_view module, name;
  Global global;
};
// numpy 2 renamed its private package to numpy._core; both spellings are in circulation.
constexpr std::array<Entry, 14> kNames = {{{"collections", "OrderedDict", Global::kOrderedDict},
                                           {"numpy.core.multiarray", "_reconstruct", Global::kNumpyReconstruct},
                                           {"numpy._core.multiarray", "_reconstruct", Global::kNumpyReconstruct},
                                           {"numpy.core.multiarray", "scalar", Global::kNumpyScalar},
                                           {"numpy._core.multiarray", "scalar", Global::kNumpyScalar},
                                           {"numpy.core.numeric", "_frombuffer", Global::kNumpyFromBuffer},
                                           {"numpy._core.numeric", "_frombuffer", Global::kNumpyFromBuffer},
                                           {"numpy", "ndarray", Global::kNumpyArray},
                                           {"numpy", "dtype", Global::kNumpyDtype},
                                           {"_codecs", "encode", Global::kCodecsEncode},
                                           {"torch._utils", "_rebuild_tensor_v2", Global::kRebuildTensor},
                                           {"torch._utils", "_rebuild_parameter", Global::kRebuildParameter},
                                           {"torch", "Size", Global::kTorchSize},
                                           {"torch", "device", Global::kTorchDevice}}};

struct StorageEntry {
  std::string_view name;
  Dtype dtype;
};
constexpr std::array<StorageEntry, 10> kStorages = {{{"FloatStorage", Dtype::kF32},
                                                     {"HalfStorage", Dtype::kF16},
                                                     {"BFloat16Storage", Dtype::kBF16},
                                                     {"DoubleStorage", Dtype::kF64},
                                                     {"LongStorage", Dtype::kI64},
                                                     {"IntStorage", Dtype::kI32},
                                                     {"ShortStorage", Dtype::kI16},
                                                     {"CharStorage", Dtype::kI8},
                                                     {"ByteStorage", Dtype::kU8},
                                                     {"BoolStorage", Dtype::kBool}}};

constexpr std::array<std::string_view, 10> kTorchDtypes = {"float32", "float16", "bfloat16", "float64", "int64",
                                                           "int32",   "int16",   "int8",     "uint8",   "bool"};

}  // namespace

bool find_global(std::string_view module, std::string_view name, Global& global, Dtype& dtype) {
  for (const Entry& entry : kNames) {
    if (entry.module == module && entry.name == name) {
      global = entry.global;
      return true;
    }
  }
  if (module != "torch") return false;
  for (const StorageEntry& entry : kStorages) {
    if (entry.name == name) {
      global = Global::kTorchStorage;
      dtype = entry.dtype;
      return true;
    }
  }
  for (const std::string_view known : kTorchDtypes) {
    if (known == name) {
      global = Global::kTorchDtype;
      return true;
    }
  }
  return false;
}

}  // namespace anigen::io::pickle
