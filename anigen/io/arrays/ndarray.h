#pragma once
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace anigen::io {

enum class Dtype { kBool, kU8, kI8, kI16, kU16, kI32, kU32, kI64, kU64, kF16, kBF16, kF32, kF64 };

/// Words of file formats for a dtype; empty where a format lacks it.
struct DtypeWords {
  Dtype dtype;
  std::size_t bytes;
  std::string_view name;  ///< numpy's and torch's: "float32", "int64", …
  std::string_view npy;   ///< without the byte order
  std::string_view safetensors;
  std::string_view torch_storage;
};

const DtypeWords& words_of(Dtype dtype);
/// @param word a member of DtypeWords @return nothing when no dtype has this text there
std::optional<Dtype> find_dtype(std::string_view DtypeWords::*word, std::string_view text);

inline std::size_t size_of(Dtype dtype) { return words_of(dtype).bytes; }
inline std::string name_of(Dtype dtype) { return std::string(words_of(dtype).name); }

/// A dense row-major array with its bytes, what array files hold. Little-endian.
struct NdArray {
  Dtype dtype = Dtype::kF32;
  std::vector<std::int64_t> shape;
  std::vector<std::uint8_t> bytes;

  std::size_t count() const;  ///< product of shape; 1 for a scalar
  /// The numbers converted to T (float, double, int32_t, int64_t, uint8_t), row-major. Booleans become 0 and 1.
  /// @throws Error when a value does not fit an integer T (out of range, not whole, NaN)
  template <typename T>
  std::vector<T> as() const;
  /// An array of dtype T from as many numbers as the shape holds. @throws Error when the counts differ
  template <typename T>
  static NdArray from(const std::vector<T>& values, std::vector<std::int64_t> shape);
};

/// Product of a shape. @return false when a size is negative or the product in bytes of `item_size` overflows
bool count_elements(const std::vector<std::int64_t>& shape, std::size_t item_size, std::size_t& count);

/// Names with their arrays, in file order.
using NamedArrays = std::vector<std::pair<std::string, NdArray>>;

/// @return nullptr when there is none of that name
const NdArray* find(const NamedArrays& arrays, const std::string& name);

/// The unsigned number whose bytes, at most 8, these are.
inline std::uint64_t little_endian(std::string_view bytes) {
  std::uint64_t value = 0;
  for (std::size_t i = bytes.size(); i-- > 0;) value = value << 8 | static_cast<unsigned char>(bytes[i]);
  return value;
}

/// 16-bit floats as they lie in files. To float is exact (subnormals included); from float rounds to nearest, ties to
/// even, and overflows to infinity, as IEEE 754 and every deep-learning framework do.
float half_to_float(std::uint16_t half);          ///< IEEE binary16: 1 sign, 5 exponent, 10 fraction bits
float bfloat16_to_float(std::uint16_t bfloat16);  ///< the upper half of a float
std::uint16_t float_to_half(float value);
std::uint16_t float_to_bfloat16(float value);

}  // namespace anigen::io
