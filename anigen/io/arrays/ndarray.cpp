#include "anigen/io/arrays/ndarray.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>

#include "anigen/core/error.h"

namespace anigen::io {

namespace {

template <typename To, typename From>
bool fits(From value) {
  if constexpr (std::is_floating_point_v<To> || std::is_same_v<To, From>) {
    return true;
  } else if constexpr (std::is_floating_point_v<From>) {
    // 2^digits is exact in double, whereas the largest 64-bit integer is not. NaN fails every comparison.
    const double limit = std::ldexp(1.0, std::numeric_limits<To>::digits);
    const double lowest = std::is_signed_v<To> ? -limit : 0.0;
    const double number = static_cast<double>(value);
    return number >= lowest && number < limit && std::trunc(number) == number;
  } else if constexpr (std::is_signed_v<From>) {
    if (value < 0) {
      return std::is_signed_v<To> &&
             static_cast<std::int64_t>(value) >= static_cast<std::int64_t>(std::numeric_limits<To>::min());
    }
    return static_cast<std::uint64_t>(value) <= static_cast<std::uint64_t>(std::numeric_limits<To>::max());
  } else {
    return static_cast<std::uint64_t>(value) <= static_cast<std::uint64_t>(std::numeric_limits<To>::max());
  }
}

template <typename To, typename Stored, typename Decode>
std::vector<To> convert(const NdArray& array, std::size_t count, Decode decode) {
  std::vector<To> values(count);
  for (std::size_t i = 0; i < count; ++i) {
    Stored stored;
    std::memcpy(&stored, array.bytes.data() + i * sizeof(Stored), sizeof(Stored));
    const auto value = decode(stored);
    if (!fits<To>(value)) {
      throw Error("element " + std::to_string(i) + " of a " + name_of(array.dtype) + " array (" +
                  std::to_string(value) + ") does not fit the integer type that is needed");
    }
    values[i] = static_cast<To>(value);
  }
  return values;
}

template <typename To, typename Stored>
std::vector<To> convert(const NdArray& array, std::size_t count) {
  return convert<To, Stored>(array, count, [](Stored value) { return value; });
}

template <typename T>
constexpr Dtype dtype_of() {
  if constexpr (std::is_same_v<T, std::uint8_t>) return Dtype::kU8;
  if constexpr (std::is_same_v<T, std::int8_t>) return Dtype::kI8;
  if constexpr (std::is_same_v<T, std::int16_t>) return Dtype::kI16;
  if constexpr (std::is_same_v<T, std::uint16_t>) return Dtype::kU16;
  if constexpr (std::is_same_v<T, std::int32_t>) return Dtype::kI32;
  if constexpr (std::is_same_v<T, std::uint32_t>) return Dtype::kU32;
  if constexpr (std::is_same_v<T, std::int64_t>) return Dtype::kI64;
  if constexpr (std::is_same_v<T, std::uint64_t>) return Dtype::kU64;
  if constexpr (std::is_same_v<T, double>) return Dtype::kF64;
  return Dtype::kF32;
}

}  // namespace

std::size_t size_of(Dtype dtype) {
  switch (dtype) {
    case Dtype::kBool:
    case Dtype::kU8:
    case Dtype::kI8:
      return 1;
    case Dtype::kI16:
    case Dtype::kU16:
    case Dtype::kF16:
    case Dtype::kBF16:
      return 2;
    case Dtype::kI32:
    case Dtype::kU32:
    case Dtype::kF32:
      return 4;
    case Dtype::kI64:
    case Dtype::kU64:
    case Dtype::kF64:
      return 8;
  }
  throw Error("unknown dtype");
}

const char* name_of(Dtype dtype) {
  static constexpr const char* kNames[] = {"bool",  "uint8",  "int8",    "int16",    "uint16",  "int32",  "uint32",
                                           "int64", "uint64", "float16", "bfloat16", "float32", "float64"};
  return kNames[static_cast<int>(dtype)];
}

bool count_elements(const std::vector<std::int64_t>& shape, std::size_t item_size, std::size_t& count) {
  constexpr std::size_t kMost = static_cast<std::size_t>(std::numeric_limits<std::int64_t>::max());
  std::size_t product = 1;
  bool empty = false;
  for (const std::int64_t size : shape) {
    if (size < 0) return false;
    empty = empty || size == 0;
  }
  for (const std::int64_t size : shape) {
    if (empty) break;
    if (product > kMost / static_cast<std::size_t>(size)) return false;
    product *= static_cast<std::size_t>(size);
  }
  count = empty ? 0 : product;
  return item_size == 0 || count <= kMost / item_size;
}

std::size_t NdArray::count() const {
  std::size_t count = 0;
  if (!count_elements(shape, size_of(dtype), count)) throw Error("an array's shape is negative or overflows");
  return count;
}

template <typename T>
std::vector<T> NdArray::as() const {
  const std::size_t n = count();
  if (bytes.size() != n * size_of(dtype)) {
    throw Error("an array of " + std::to_string(n) + " " + name_of(dtype) + " holds " + std::to_string(bytes.size()) +
                " bytes");
  }
  switch (dtype) {
    case Dtype::kBool:
      return convert<T, std::uint8_t>(*this, n, [](std::uint8_t value) { return static_cast<int>(value != 0); });
    case Dtype::kU8:
      return convert<T, std::uint8_t>(*this, n);
    case Dtype::kI8:
      return convert<T, std::int8_t>(*this, n);
    case Dtype::kI16:
      return convert<T, std::int16_t>(*this, n);
    case Dtype::kU16:
      return convert<T, std::uint16_t>(*this, n);
    case Dtype::kI32:
      return convert<T, std::int32_t>(*this, n);
    case Dtype::kU32:
      return convert<T, std::uint32_t>(*this, n);
    case Dtype::kI64:
      return convert<T, std::int64_t>(*this, n);
    case Dtype::kU64:
      return convert<T, std::uint64_t>(*this, n);
    case Dtype::kF16:
      return convert<T, std::uint16_t>(*this, n, half_to_float);
    case Dtype::kBF16:
      return convert<T, std::uint16_t>(*this, n, bfloat16_to_float);
    case Dtype::kF32:
      return convert<T, float>(*this, n);
    case Dtype::kF64:
      return convert<T, double>(*this, n);
  }
  throw Error("unknown dtype");
}

template <typename T>
NdArray NdArray::from(const std::vector<T>& values, std::vector<std::int64_t> shape) {
  NdArray array;
  array.dtype = dtype_of<T>();
  array.shape = std::move(shape);
  if (array.count() != values.size()) {
    throw Error("an array of " + std::to_string(array.count()) + " elements cannot be made from " +
                std::to_string(values.size()) + " values");
  }
  array.bytes.resize(values.size() * sizeof(T));
  if (!values.empty()) std::memcpy(array.bytes.data(), values.data(), array.bytes.size());
  return array;
}

#define ANIGEN_NDARRAY_TYPE(T)                    \
  template std::vector<T> NdArray::as<T>() const; \
  template NdArray NdArray::from<T>(const std::vector<T>&, std::vector<std::int64_t>);
ANIGEN_NDARRAY_TYPE(float)
ANIGEN_NDARRAY_TYPE(double)
ANIGEN_NDARRAY_TYPE(std::int8_t)
ANIGEN_NDARRAY_TYPE(std::uint8_t)
ANIGEN_NDARRAY_TYPE(std::int16_t)
ANIGEN_NDARRAY_TYPE(std::uint16_t)
ANIGEN_NDARRAY_TYPE(std::int32_t)
ANIGEN_NDARRAY_TYPE(std::uint32_t)
ANIGEN_NDARRAY_TYPE(std::int64_t)
ANIGEN_NDARRAY_TYPE(std::uint64_t)
#undef ANIGEN_NDARRAY_TYPE

const NdArray* find(const NamedArrays& arrays, const std::string& name) {
  for (const auto& [key, array] : arrays) {
    if (key == name) return &array;
  }
  return nullptr;
}

namespace {

std::uint32_t bits_of(float value) {
  std::uint32_t bits;
  std::memcpy(&bits, &value, sizeof bits);
  return bits;
}

float float_of(std::uint32_t bits) {
  float value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

/// Drops the low bits of a magnitude, rounding to nearest even. A carry runs on into the exponent, as it should.
std::uint32_t shift_rounding_to_even(std::uint32_t magnitude, int bits) {
  const std::uint32_t half_way = 1u << (bits - 1);
  const std::uint32_t odd = (magnitude >> bits) & 1u;
  return (magnitude + half_way - 1u + odd) >> bits;
}

}  // namespace

float half_to_float(std::uint16_t half) {
  const std::uint32_t sign = static_cast<std::uint32_t>(half & 0x8000u) << 16;
  const std::uint32_t exponent = (half >> 10) & 0x1Fu;
  const std::uint32_t fraction = half & 0x3FFu;
  if (exponent == 0x1F) return float_of(sign | 0x7F800000u | (fraction << 13));
  if (exponent != 0) return float_of(sign | ((exponent + 112u) << 23) | (fraction << 13));
  const float magnitude = std::ldexp(static_cast<float>(fraction), -24);  // zero and subnormals
  return sign ? -magnitude : magnitude;
}

float bfloat16_to_float(std::uint16_t bfloat16) { return float_of(static_cast<std::uint32_t>(bfloat16) << 16); }

std::uint16_t float_to_half(float value) {
  const std::uint32_t bits = bits_of(value);
  const std::uint32_t sign = (bits >> 16) & 0x8000u;
  const std::uint32_t magnitude = bits & 0x7FFFFFFFu;
  std::uint32_t result;
  if (magnitude > 0x7F800000u) {
    result = 0x7E00u | ((magnitude >> 13) & 0x3FFu);  // quiet NaN
  } else if (magnitude >= 0x477FF000u) {              // 65520 and above round to infinity
    result = 0x7C00u;
  } else if (magnitude >= 0x38800000u) {  // normal halves start at 2^-14
    result = shift_rounding_to_even(magnitude - (112u << 23), 13);
  } else {
    const int exponent = static_cast<int>(magnitude >> 23);
    const int shift = 126 - exponent;  // a subnormal half counts units of 2^-24
    result = shift > 24 ? 0u : shift_rounding_to_even((magnitude & 0x7FFFFFu) | 0x800000u, shift);
  }
  return static_cast<std::uint16_t>(sign | result);
}

std::uint16_t float_to_bfloat16(float value) {
  const std::uint32_t bits = bits_of(value);
  if ((bits & 0x7FFFFFFFu) > 0x7F800000u) return static_cast<std::uint16_t>((bits >> 16) | 0x40u);
  return static_cast<std::uint16_t>(((bits >> 16) & 0x8000u) | shift_rounding_to_even(bits & 0x7FFFFFFFu, 16));
}

}  // namespace anigen::io
