#pragma once
#include <cstdint>
#include <string>
#include <string_view>

#include "anigen/io/arrays/pickle.h"

namespace anigen::io::pickle {

/// Reads instructions and their arguments off the bytes of a pickle; every failure names the byte of the instruction.
class Scanner {
 public:
  Scanner(std::string_view input, const Source& source) : input_(input), source_(source) {}

  unsigned char next_instruction();
  std::uint64_t number(std::size_t size);       ///< little-endian, 1 to 8 bytes
  std::string_view bytes(std::uint64_t count);  ///< the next bytes, not copied
  std::string_view line();                      ///< up to the next newline, without it
  double big_endian_double();

  bool parse_decimal(std::string_view line, std::int64_t& integer);  ///< false when it exceeds 64 bits
  double parse_float(std::string_view line);
  std::string unquote(std::string_view line);           ///< a Python string literal with its quotes
  std::string unescape_unicode(std::string_view line);  ///< Python's raw-unicode-escape, to UTF-8
  void check_utf8(std::string_view text);

  std::string place() const;
  [[noreturn]] void fail(const std::string& problem) const;

 private:
  std::uint32_t digits(std::string_view text, std::size_t first, std::size_t count, int base);

  std::string_view input_;
  const Source& source_;
  std::size_t at_ = 0, instruction_ = 0;
};

}  // namespace anigen::io::pickle
