#include "anigen/io/arrays/npy.h"

#include <algorithm>
#include <cstring>

#include "anigen/core/error.h"

namespace anigen::io {
namespace {

void swap_bytes(std::vector<std::uint8_t>& raw, std::size_t item_size) {
  if (item_size < 2) return;
  for (std::size_t i = 0; i + item_size <= raw.size(); i += item_size) {
    std::reverse(raw.begin() + static_cast<std::ptrdiff_t>(i),
                 raw.begin() + static_cast<std::ptrdiff_t>(i + item_size));
  }
}

std::string descr_of(Dtype dtype, const std::string& name) {
  switch (dtype) {
    case Dtype::kBool:
      return "|b1";
    case Dtype::kU8:
      return "|u1";
    case Dtype::kI8:
      return "|i1";
    case Dtype::kI16:
      return "<i2";
    case Dtype::kU16:
      return "<u2";
    case Dtype::kI32:
      return "<i4";
    case Dtype::kU32:
      return "<u4";
    case Dtype::kI64:
      return "<i8";
    case Dtype::kU64:
      return "<u8";
    case Dtype::kF16:
      return "<f2";
    case Dtype::kF32:
      return "<f4";
    case Dtype::kF64:
      return "<f8";
    case Dtype::kBF16:
      break;
  }
  throw Error("array '" + name + "' is bfloat16, which NPY files cannot hold; convert it to float32 first");
}

}  // namespace

std::vector<std::uint8_t> from_fortran_order(const std::vector<std::uint8_t>& raw,
                                             const std::vector<std::int64_t>& shape, std::size_t item_size) {
  if (shape.size() < 2 || raw.empty()) return raw;
  std::vector<std::uint8_t> out(raw.size());
  const std::size_t rank = shape.size();
  std::vector<std::size_t> stride(rank), index(rank, 0);
  std::size_t step = 1;
  for (std::size_t d = 0; d < rank; ++d) {
    stride[d] = step;
    step *= static_cast<std::size_t>(shape[d]);
  }
  std::size_t source = 0;
  for (std::size_t i = 0; i < step; ++i) {
    std::memcpy(out.data() + i * item_size, raw.data() + source * item_size, item_size);
    for (std::size_t d = rank; d-- > 0;) {
      source += stride[d];
      if (++index[d] < static_cast<std::size_t>(shape[d])) break;
      source -= stride[d] * index[d];
      index[d] = 0;
    }
  }
  return out;
}

NdArray decode_npy(const NpyHeader& header, std::vector<std::uint8_t> raw, const NpyPlace& place) {
  if (header.element.kind != NpyElement::Kind::kNumber) {
    throw NotSupportedError(place.file, place.member, "text or objects as a numeric array");
  }
  std::size_t count = 0;
  if (!count_elements(header.shape, header.element.size, count)) {
    throw InputError(place.file, place.member, "its shape overflows");
  }
  if (raw.size() != count * header.element.size) {
    throw InputError(place.file, place.member,
                     "its shape needs " + std::to_string(count * header.element.size) + " bytes and " +
                         std::to_string(raw.size()) + " are there");
  }
  if (header.element.big_endian) swap_bytes(raw, header.element.size);
  if (header.fortran_order) raw = from_fortran_order(raw, header.shape, header.element.size);
  if (header.element.dtype == Dtype::kBool) {
    for (std::uint8_t& value : raw) value = value != 0;
  }
  return NdArray{header.element.dtype, header.shape, std::move(raw)};
}

std::string encode_npy(const NdArray& array, const std::string& name_for_errors) {
  if (array.bytes.size() != array.count() * size_of(array.dtype)) {
    throw Error("array '" + name_for_errors + "' holds " + std::to_string(array.bytes.size()) +
                " bytes, which is not what its shape says");
  }
  std::string shape = "(";
  for (const std::int64_t size : array.shape) shape += std::to_string(size) + ", ";
  if (array.shape.size() > 1) shape.resize(shape.size() - 2);   // (3, 4)
  if (array.shape.size() == 1) shape.resize(shape.size() - 1);  // (3,)
  std::string header =
      "{'descr': '" + descr_of(array.dtype, name_for_errors) + "', 'fortran_order': False, 'shape': " + shape + "), }";
  constexpr std::size_t kPrefix = 10, kAlignment = 64;
  header.append(kAlignment - (kPrefix + header.size() + 1) % kAlignment, ' ');
  header += '\n';
  std::string bytes("\x93NUMPY\x01\x00", 8);
  bytes += static_cast<char>(header.size() & 0xFF);
  bytes += static_cast<char>(header.size() >> 8);
  bytes += header;
  bytes.append(reinterpret_cast<const char*>(array.bytes.data()), array.bytes.size());
  return bytes;
}

}  // namespace anigen::io
