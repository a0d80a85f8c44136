#include "anigen/io/arrays/ndarray.h"

#include <Eigen/Core>
#include <cmath>
#include <cstring>
#include <limits>
#include <tuple>
#include <type_traits>

#include "anigen/core/error.h"

namespace anigen::io {

using Eigen::numext::bit_cast;

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

template <typename T>
struct Stored {
  using Type = T;
  static T value(T stored) { return stored; }
};
struct StoredBool : Stored<std::uint8_t> {
  static int value(std::uint8_t stored) { return stored != 0; }
};
struct StoredHalf : Stored<std::uint16_t> {
  static float value(std::uint16_t stored) { return half_to_float(stored); }
};
struct StoredBfloat16 : Stored<std::uint16_t> {
  static float value(std::uint16_t stored) { return bfloat16_to_float(stored); }
};

// In the order of Dtype.
using StoredTypes = std::tuple<StoredBool, Stored<std::uint8_t>, Stored<std::int8_t>, Stored<std::int16_t>,
                               Stored<std::uint16_t>, Stored<std::int32_t>, Stored<std::uint32_t>, Stored<std::int64_t>,
                               Stored<std::uint64_t>, StoredHalf, StoredBfloat16, Stored<float>, Stored<double>>;

template <typename To, typename From>
std::vector<To> convert(const NdArray& array, std::size_t count) {
  std::vector<To> values(count);
  for (std::size_t i = 0; i < count; ++i) {
    typename From::Type stored;
    std::memcpy(&stored, array.bytes.data() + i * sizeof stored, sizeof stored);
    const auto value = From::value(stored);
    if (!fits<To>(value)) {
      throw Error("element " + std::to_string(i) + " of a " + name_of(array.dtype) + " array (" +
                  std::to_string(value) + ") does not fit the integer type that is needed");
    }
    values[i] = static_cast<To>(value);
  }
  return values;
}

template <typename To, std::size_t... Index>
std::vector<To> convert_any(const NdArray& array, std::size_t count, std::index_sequence<Index...>) {
  using Convert = std::vector<To> (*)(const NdArray&, std::size_t);
  static constexpr Convert kConvert[] = {convert<To, std::tuple_element_t<Index, StoredTypes>>...};
  return kConvert[static_cast<std::size_t>(array.dtype)](array, count);
}

template <typename T, std::size_t Index = 1>  // booleans have no type of their own
constexpr Dtype dtype_of() {
  if constexpr (std::is_same_v<Stored<T>, std::tuple_element_t<Index, StoredTypes>>)
    return static_cast<Dtype>(Index);
  else
    return dtype_of<T, Index + 1>();
}

constexpr DtypeWords kWords[] = {{Dtype::kBool, 1, "bool", "b1", "BOOL", "BoolStorage"},
                                 {Dtype::kU8, 1, "uint8", "u1", "U8", "ByteStorage"},
                                 {Dtype::kI8, 1, "int8", "i1", "I8", "CharStorage"},
                                 {Dtype::kI16, 2, "int16", "i2", "I16", "ShortStorage"},
                                 {Dtype::kU16, 2, "uint16", "u2", "U16", ""},
                                 {Dtype::kI32, 4, "int32", "i4", "I32", "IntStorage"},
                                 {Dtype::kU32, 4, "uint32", "u4", "U32", ""},
                                 {Dtype::kI64, 8, "int64", "i8", "I64", "LongStorage"},
                                 {Dtype::kU64, 8, "uint64", "u8", "U64", ""},
                                 {Dtype::kF16, 2, "float16", "f2", "F16", "HalfStorage"},
                                 {Dtype::kBF16, 2, "bfloat16", "", "BF16", "BFloat16Storage"},
                                 {Dtype::kF32, 4, "float32", "f4", "F32", "FloatStorage"},
                                 {Dtype::kF64, 8, "float64", "f8", "F64", "DoubleStorage"}};

}  // namespace

const DtypeWords& words_of(Dtype dtype) { return kWords[static_cast<std::size_t>(dtype)]; }

std::optional<Dtype> find_dtype(std::string_view DtypeWords::*word, std::string_view text) {
  for (const DtypeWords& words : kWords) {
    if (!text.empty() && words.*word == text) return words.dtype;
  }
  return std::nullopt;
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
  return convert_any<T>(*this, n, std::make_index_sequence<std::tuple_size_v<StoredTypes>>());
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

float half_to_float(std::uint16_t half) { return static_cast<float>(bit_cast<Eigen::half>(half)); }
float bfloat16_to_float(std::uint16_t bfloat16) { return static_cast<float>(bit_cast<Eigen::bfloat16>(bfloat16)); }
std::uint16_t float_to_half(float value) { return bit_cast<std::uint16_t>(Eigen::half(value)); }
std::uint16_t float_to_bfloat16(float value) { return bit_cast<std::uint16_t>(Eigen::bfloat16(value)); }

}  // namespace anigen::io
