#include "anigen/io/ndarray.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>

#include "anigen/core/error.h"
#include "anigen/io/arrays/half.h"

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

}  // namespace anigen::io
