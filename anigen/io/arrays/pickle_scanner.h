#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "anigen/io/arrays/pickle.h"

namespace anigen::io::pickle {

/// Reads instructions and their arguments off the bytes of a pickle, which lie in memory or come piece by piece; every
/// failure names the byte of the instruction.
class Scanner {
 public:
  Scanner(std::string_view input, const Source& source) : input_(input), source_(source) {}
  Scanner(const ByteSource& bytes, const Source& source) : bytes_(&bytes), source_(source) {}

  bool streams() const { return bytes_ != nullptr; }
  std::uint64_t size() const { return streams() ? bytes_->size() : input_.size(); }
  std::uint64_t position() const { return base_ + at_; }      ///< of the next byte
  std::uint64_t instruction() const { return instruction_; }  ///< of the last instruction
  bool at_end() const { return position() == size(); }

  unsigned char next_instruction() {
    instruction_ = position();
    return static_cast<unsigned char>(bytes(1)[0]);
  }
  /// Little-endian, 1 to 8 bytes.
  std::uint64_t number(std::size_t size) { return little_endian(bytes(size)); }
  /// The next bytes, not copied: from a source they last until the next call.
  std::string_view bytes(std::uint64_t count);
  void skip(std::uint64_t count);
  /// Up to the next newline, without it; lasts as bytes() does.
  std::string_view line();

  double big_endian_double();
  /// False when it exceeds 64 bits.
  bool parse_decimal(std::string_view line, std::int64_t& integer) const;
  double parse_float(std::string_view line) const;
  /// A Python string literal with its quotes.
  std::string unquote(std::string_view line) const;
  /// Python's raw-unicode-escape, to UTF-8.
  std::string unescape_unicode(std::string_view line) const;
  void check_utf8(std::string_view text) const;

  std::string place() const;
  [[noreturn]] void fail(const std::string& problem) const;

 private:
  std::uint64_t left() const { return size() - position(); }
  void fetch(std::size_t count);
  std::uint32_t digits(std::string_view text, std::size_t first, std::size_t count, int base) const;

  std::string_view input_;  ///< all of it, or the window of a source that begins at base_
  const ByteSource* bytes_ = nullptr;
  const Source& source_;
  std::string window_;
  std::uint64_t base_ = 0, instruction_ = 0;
  std::size_t at_ = 0;
};

}  // namespace anigen::io::pickle
