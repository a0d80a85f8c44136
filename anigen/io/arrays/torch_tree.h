#pragma once
#include <string>
#include <vector>

#include "anigen/io/arrays/npy.h"
#include "anigen/io/arrays/pickle.h"

namespace anigen::io {

/// Something with numbers in it that a torch pickle holds, under its path joined with '.'.
struct TorchLeaf {
  std::string name;
  const pickle::Value* value;  ///< a tensor, a numpy array, or a bool, int or float
};

/// Walks dicts, lists and tuples in order. Strings, None, devices and dtypes are left out.
/// @throws InputError for cycles, sharing that explodes, and two values of one path
std::vector<TorchLeaf> torch_leaves(const pickle::Value& root, const NpyPlace& place);

}  // namespace anigen::io
