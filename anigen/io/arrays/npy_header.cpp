#include <cctype>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/io/arrays/npy.h"

namespace anigen::io {
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

bool number_type(char kind, std::size_t size, Dtype& dtype) {
  struct Row {
    char kind;
    std::size_t size;
    Dtype dtype;
  };
  static constexpr Row kRows[] = {{'b', 1, Dtype::kBool}, {'u', 1, Dtype::kU8},  {'i', 1, Dtype::kI8},
                                  {'i', 2, Dtype::kI16},  {'u', 2, Dtype::kU16}, {'i', 4, Dtype::kI32},
                                  {'u', 4, Dtype::kU32},  {'i', 8, Dtype::kI64}, {'u', 8, Dtype::kU64},
                                  {'f', 2, Dtype::kF16},  {'f', 4, Dtype::kF32}, {'f', 8, Dtype::kF64}};
  for (const Row& row : kRows) {
    if (row.kind == kind && row.size == size) {
      dtype = row.dtype;
      return true;
    }
  }
  return false;
}

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
  } else if (!digits_only || !number_type(kind, size, element.dtype)) {
    throw NotSupportedError(place.file, place.member, "numpy dtype '" + whole + "'");
  }
  return element;
}

NpyHeader parse_npy_header(std::string_view text, std::size_t first_byte, const NpyPlace& place) {
  return LiteralReader(text, first_byte, place).header();
}

}  // namespace anigen::io
