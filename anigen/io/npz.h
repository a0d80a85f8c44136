#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "anigen/io/ndarray.h"

namespace anigen::io {

/// Reads every array of an NPZ archive (stored or deflated members, NPY versions 1 to 3, C or Fortran order,
/// little or big endian, numeric dtypes). Pickled object arrays become numbers where they can:
///   - ints and None, which public rig datasets use for `parents`: int64 with None as -1; ints and floats: float64;
///   - dicts, lists and arrays inside (Articulation-XL 2.0, reference anymate-baselines.md, 10.1): one array per
///     number or array found, under dotted keys such as "arr_0.17.vertices"; strings inside are left out, get them
///     from read_npz_objects.
/// Arrays of strings and other objects are refused by name.
/// @throws InputError naming file, member and byte
NamedArrays read_npz(const std::filesystem::path& path);

/// Only these members, so that large files are not read whole. Missing names are an InputError that lists what is
/// there.
NamedArrays read_npz(const std::filesystem::path& path, const std::vector<std::string>& names);

/// Names, dtypes and shapes without the data. Members that do not hold numbers are left out.
NamedArrays read_npz_headers(const std::filesystem::path& path);

/// Atomic; deflated; fixed time stamps, so equal arrays give equal bytes. numpy.load reads it.
/// @throws Error for bfloat16, which numpy has no type for
void write_npz(const std::filesystem::path& path, const NamedArrays& arrays);

/// A Python object as it was pickled into an NPZ member: a tree of dicts and lists with numbers, strings and arrays.
struct NpzValue {
  enum class Kind { kNone, kBool, kInteger, kReal, kString, kArray, kList, kDict };
  Kind kind = Kind::kNone;
  std::int64_t integer = 0;       ///< kInteger, and 0 or 1 for kBool
  double real = 0;                ///< kReal
  std::string text;               ///< kString: UTF-8, or the bytes of a bytes object
  NdArray array;                  ///< kArray
  std::vector<std::string> keys;  ///< kDict: one per item, in order
  std::vector<NpzValue> items;    ///< kList (also tuples, sets, object arrays) and kDict

  /// @return the item of a dict; nullptr when there is none, or when this is no dict
  const NpzValue* find(const std::string& key) const;
};

/// Members as object trees: numeric members are kArray, arrays of text or objects are lists (of lists when they have
/// more dimensions), a 0-d object array is its object. @param names only these members; empty: all
std::vector<std::pair<std::string, NpzValue>> read_npz_objects(const std::filesystem::path& path,
                                                               const std::vector<std::string>& names = {});

}  // namespace anigen::io
