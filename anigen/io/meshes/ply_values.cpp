#include "anigen/io/meshes/ply_values.h"

#include <cmath>
#include <cstring>

#include "anigen/core/error.h"
#include "anigen/io/meshes/number_text.h"

namespace anigen::io {
namespace {

bool is_blank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n' || c == '\v' || c == '\f'; }

template <typename Float, typename Bits>
double from_bits(Bits bits) {
  static_assert(sizeof(Float) == sizeof(Bits));
  Float value;
  std::memcpy(&value, &bits, sizeof(value));
  return static_cast<double>(value);
}

}  // namespace

PlyValues::PlyValues(const std::string& bytes, const PlyHeader& header, const std::string& file)
    : bytes_(bytes), file_(file), format_(header.format), at_(header.bytes), line_(header.lines + 1) {}

void PlyValues::fail(const std::string& problem) const {
  const bool text = format_ == PlyFormat::kAscii;
  throw InputError(file_, text ? "line " + std::to_string(line_) : "byte " + std::to_string(at_), problem);
}

double PlyValues::next(PlyType type) { return format_ == PlyFormat::kAscii ? next_text(type) : next_binary(type); }

std::size_t PlyValues::next_length(const PlyProperty& property) {
  const double length = next(property.count_type);
  if (length < 0.0) fail("a list of negative length");
  const double item = format_ == PlyFormat::kAscii ? 2.0 : static_cast<double>(size_of(property.type));
  if (length * item > static_cast<double>(bytes_.size() - at_) + 1.0) {
    fail("a list of " + std::to_string(static_cast<std::uint64_t>(length)) + " items reaches beyond the end");
  }
  return static_cast<std::size_t>(length);
}

double PlyValues::next_text(PlyType type) {
  for (; at_ < bytes_.size() && is_blank(bytes_[at_]); ++at_) line_ += bytes_[at_] == '\n' ? 1 : 0;
  if (at_ == bytes_.size()) fail("the file ends too early");
  const std::size_t begin = at_;
  while (at_ < bytes_.size() && !is_blank(bytes_[at_])) ++at_;
  const std::string_view token(bytes_.data() + begin, at_ - begin);
  double value = 0.0;
  if (!parse_number(token, value)) fail("'" + std::string(token.substr(0, 40)) + "' is not a number");
  if (is_integer(type)) {
    const double high = largest_of(type);
    const bool is_signed = type == PlyType::kInt8 || type == PlyType::kInt16 || type == PlyType::kInt32;
    const double low = is_signed ? -high - 1.0 : 0.0;
    if (!(value >= low && value <= high) || value != std::floor(value)) {
      fail("'" + std::string(token.substr(0, 40)) + "' does not fit its integer type");
    }
  }
  return value;
}

double PlyValues::next_binary(PlyType type) {
  const std::size_t size = size_of(type);
  if (bytes_.size() - at_ < size) fail("the file ends too early");
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < size; ++i) {
    const std::size_t source = format_ == PlyFormat::kBigEndian ? i : size - 1 - i;
    bits = bits << 8 | static_cast<unsigned char>(bytes_[at_ + source]);
  }
  at_ += size;
  switch (type) {
    case PlyType::kInt8:
      return static_cast<std::int8_t>(bits);
    case PlyType::kInt16:
      return static_cast<std::int16_t>(bits);
    case PlyType::kInt32:
      return static_cast<std::int32_t>(bits);
    case PlyType::kFloat32:
      return from_bits<float>(static_cast<std::uint32_t>(bits));
    case PlyType::kFloat64:
      return from_bits<double>(bits);
    default:
      return static_cast<double>(bits);
  }
}

}  // namespace anigen::io
