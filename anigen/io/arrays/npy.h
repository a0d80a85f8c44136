#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/io/arrays/ndarray.h"

namespace anigen::io {

/// Type of one element of an NPY array. Exactly numpy's description string, taken apart.
struct NpyElement {
  enum class Kind { kNumber, kObject, kUnicode, kBytes };
  Kind kind = Kind::kNumber;
  Dtype dtype = Dtype::kF32;  ///< for numbers
  std::size_t size = 4;       ///< bytes per element in the file; 0 for objects
  bool big_endian = false;
};

struct NpyHeader {
  NpyElement element;
  bool fortran_order = false;
  std::vector<std::int64_t> shape;
};

/// Place of a problem, for messages.
struct NpyPlace {
  std::string file, member;

  [[noreturn]] void fail(const std::string& problem) const { throw InputError(file, member, problem); }
  [[noreturn]] void refuse(const std::string& feature) const { throw NotSupportedError(file, member, feature); }
};

/// numpy's descr string, such as "<f4", "|b1", ">i8", "|O", "<U12". @throws NotSupportedError for complex numbers,
/// dates, structures and other types without a counterpart here
NpyElement parse_npy_element(std::string_view descr, const NpyPlace& place);

/// The Python dict literal of an NPY header, {'descr': '<f4', 'fortran_order': False, 'shape': (3, 4), }.
/// @param first_byte where it begins in the member, for messages
NpyHeader parse_npy_header(std::string_view text, std::size_t first_byte, const NpyPlace& place);

/// Turns elements as they lie in a file into a little-endian row-major array.
/// @throws InputError when the shape overflows or raw is not exactly its size
NdArray decode_npy(const NpyHeader& header, std::vector<std::uint8_t> raw, const NpyPlace& place);

/// One element of fixed-width text without its padding, as UTF-8 ("<U12") or as the bytes are ("|S12").
/// @throws InputError for what is no Unicode character
std::string decode_npy_text(const NpyElement& element, std::string_view raw, const NpyPlace& place);

/// Appends one Unicode character as UTF-8. @return false when there is no such character
bool append_utf8(std::uint32_t character, std::string& text);

/// NPY version 1.0 bytes, header padded so that data start at a multiple of 64. @throws Error for bfloat16, which
/// numpy has no type for
std::string encode_npy(const NdArray& array, const std::string& name_for_errors);

}  // namespace anigen::io
