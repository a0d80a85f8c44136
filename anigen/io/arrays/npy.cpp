#include "anigen/io/arrays/npy.h"

#include <algorithm>
#include <cctype>
#include <cstring>
#include <limits>

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
  const DtypeWords& words = words_of(dtype);
  if (words.npy.empty())
    throw Error("array '" + name + "' is bfloat16, which NPY files cannot hold; convert it to float32 first");
  return (words.bytes == 1 ? "|" : "<") + std::string(words.npy);
}

// Row-major copy of column-major elements of item_size bytes. Sizes must agree.
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

}  // namespace

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

namespace {

/// Reads the small subset of Python literals that numpy writes into headers: one dict of strings, booleans and
/// tuples of integers. Nothing nests, so nothing recurses.
class LiteralReader {
 public:
  LiteralReader(std::string_view text, std::size_t first_byte, const NpyPlace& place)
      : text_(text), first_byte_(first_byte), place_(place) {}

  NpyHeader header() {
    NpyHeader header;
    bool seen_descr = false, seen_order = false, seen_shape = false;
    expect('{');
    while (!accept('}')) {
      const std::string key = string();
      expect(':');
      if (key == "descr" && !seen_descr) {
        seen_descr = true;
        skip_space();
        if (peek() == '[' || peek() == '(') throw NotSupportedError(place_.file, where(), "structured NPY dtypes");
        header.element = parse_npy_element(string(), place_);
      } else if (key == "fortran_order" && !seen_order) {
        seen_order = true;
        header.fortran_order = boolean();
      } else if (key == "shape" && !seen_shape) {
        seen_shape = true;
        header.shape = tuple();
      } else {
        fail("unexpected or repeated key '" + key + "' in the NPY header");
      }
      if (!accept(',')) {
        expect('}');
        break;
      }
    }
    skip_space();
    if (at_ != text_.size()) fail("text after the NPY header's dict");
    if (!seen_descr || !seen_order || !seen_shape) fail("the NPY header lacks descr, fortran_order or shape");
    return header;
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const { throw InputError(place_.file, where(), problem); }
  std::string where() const { return place_.member + ", byte " + std::to_string(first_byte_ + at_); }
  char peek() const { return at_ < text_.size() ? text_[at_] : '\0'; }
  void skip_space() {
    while (at_ < text_.size() && std::isspace(static_cast<unsigned char>(text_[at_]))) ++at_;
  }
  bool accept(char wanted) {
    skip_space();
    if (peek() != wanted) return false;
    ++at_;
    return true;
  }
  void expect(char wanted) {
    if (!accept(wanted)) fail(std::string("expected '") + wanted + "' in the NPY header");
  }

  std::string string() {
    skip_space();
    const char quote = peek();
    if (quote != '\'' && quote != '"') fail("expected a string in the NPY header");
    const std::size_t end = text_.find(quote, at_ + 1);
    if (end == std::string_view::npos) fail("unfinished string in the NPY header");
    const std::string value(text_.substr(at_ + 1, end - at_ - 1));
    if (value.find('\\') != std::string::npos) fail("escape in a string of the NPY header");
    at_ = end + 1;
    return value;
  }

  bool boolean() {
    skip_space();
    for (const bool value : {true, false}) {
      const std::string_view word = value ? "True" : "False";
      if (text_.substr(at_, word.size()) == word) {
        at_ += word.size();
        return value;
      }
    }
    fail("expected True or False in the NPY header");
  }

  std::vector<std::int64_t> tuple() {
    constexpr std::size_t kMaxDimensions = 64;  // numpy's own limit
    std::vector<std::int64_t> sizes;
    expect('(');
    while (!accept(')')) {
      sizes.push_back(integer());
      if (sizes.size() > kMaxDimensions) fail("more than 64 dimensions");
      if (accept(',')) continue;
      expect(')');
      break;
    }
    return sizes;
  }

  std::int64_t integer() {
    skip_space();
    if (peek() == '-') fail("negative size in the NPY header's shape");
    if (!std::isdigit(static_cast<unsigned char>(peek()))) fail("expected a size in the NPY header's shape");
    std::int64_t value = 0;
    for (; std::isdigit(static_cast<unsigned char>(peek())); ++at_) {
      const int digit = peek() - '0';
      if (value > (std::numeric_limits<std::int64_t>::max() - digit) / 10) fail("a size in the NPY header overflows");
      value = value * 10 + digit;
    }
    if (peek() == 'L') ++at_;  // Python 2 wrote long integers so
    return value;
  }

  std::string_view text_;
  std::size_t first_byte_, at_ = 0;
  const NpyPlace& place_;
};

}  // namespace

NpyElement parse_npy_element(std::string_view descr, const NpyPlace& place) {
  const std::string whole(descr);
  NpyElement element;
  if (!descr.empty() && std::string_view("<>|=").find(descr[0]) != std::string_view::npos) {
    element.big_endian = descr[0] == '>';
    descr.remove_prefix(1);
  }
  const char kind = descr.empty() ? '\0' : descr[0];
  std::size_t size = 0;
  bool digits_only = descr.size() > (kind == 'O' ? 0u : 1u) && descr.size() < 12;
  for (std::size_t i = 1; digits_only && i < descr.size(); ++i) {
    digits_only = std::isdigit(static_cast<unsigned char>(descr[i])) != 0;
    size = size * 10 + static_cast<std::size_t>(descr[i] - '0');
  }
  element.size = size;
  if (digits_only && kind == 'O') {
    element.kind = NpyElement::Kind::kObject;
    element.size = 0;
  } else if (digits_only && kind == 'U') {
    element.kind = NpyElement::Kind::kUnicode;
    element.size = 4 * size;  // UCS-4
  } else if (digits_only && kind == 'S') {
    element.kind = NpyElement::Kind::kBytes;
  } else {
    // By its number, for numpy also writes "f04".
    const auto dtype = find_dtype(&DtypeWords::npy, digits_only ? kind + std::to_string(size) : "");
    if (!dtype) throw NotSupportedError(place.file, place.member, "numpy dtype '" + whole + "'");
    element.dtype = *dtype;
  }
  return element;
}

NpyHeader parse_npy_header(std::string_view text, std::size_t first_byte, const NpyPlace& place) {
  return LiteralReader(text, first_byte, place).header();
}

bool append_utf8(std::uint32_t character, std::string& text) {
  const auto tail = [&](int shift) { text += static_cast<char>(0x80u | ((character >> shift) & 0x3Fu)); };
  if (character > 0x10FFFF || (character >= 0xD800 && character < 0xE000)) return false;
  if (character < 0x80) {
    text += static_cast<char>(character);
  } else if (character < 0x800) {
    text += static_cast<char>(0xC0u | (character >> 6));
    tail(0);
  } else if (character < 0x10000) {
    text += static_cast<char>(0xE0u | (character >> 12));
    tail(6);
    tail(0);
  } else {
    text += static_cast<char>(0xF0u | (character >> 18));
    tail(12);
    tail(6);
    tail(0);
  }
  return true;
}

std::string decode_npy_text(const NpyElement& element, std::string_view raw, const NpyPlace& place) {
  if (element.kind == NpyElement::Kind::kBytes) {
    const std::size_t last = raw.find_last_not_of('\0');
    return std::string(raw.substr(0, last == std::string_view::npos ? 0 : last + 1));
  }
  std::vector<std::uint32_t> characters(raw.size() / 4);
  for (std::size_t i = 0; i < characters.size(); ++i) {
    for (std::size_t b = 0; b < 4; ++b) {
      const auto byte = static_cast<unsigned char>(raw[4 * i + (element.big_endian ? 3 - b : b)]);
      characters[i] |= static_cast<std::uint32_t>(byte) << (8 * b);
    }
  }
  while (!characters.empty() && characters.back() == 0) characters.pop_back();
  std::string text;
  for (const std::uint32_t character : characters) {
    if (!append_utf8(character, text)) throw InputError(place.file, place.member, "text that is not Unicode");
  }
  return text;
}

}  // namespace anigen::io
