#include "anigen/io/arrays/pickle_scanner.h"

#include <charconv>
#include <cstring>

#include "anigen/core/error.h"

namespace anigen::io::pickle {

std::string Scanner::place() const {
  return source_.member + ", byte " + std::to_string(source_.first_byte + instruction_);
}

void Scanner::fail(const std::string& problem) const { throw InputError(source_.file, place(), problem); }

unsigned char Scanner::next_instruction() {
  instruction_ = at_;
  return static_cast<unsigned char>(bytes(1)[0]);
}

std::string_view Scanner::bytes(std::uint64_t count) {
  if (count > input_.size() - at_) fail("the pickle ends early");
  const std::string_view found = input_.substr(at_, count);
  at_ += count;
  return found;
}

std::uint64_t Scanner::number(std::size_t size) {
  const std::string_view raw = bytes(size);
  std::uint64_t value = 0;
  for (std::size_t i = size; i-- > 0;) value = value << 8 | static_cast<unsigned char>(raw[i]);
  return value;
}

std::string_view Scanner::line() {
  const std::size_t end = input_.find('\n', at_);
  if (end == std::string_view::npos) fail("the pickle ends early");
  const std::string_view found = input_.substr(at_, end - at_);
  at_ = end + 1;
  return found;
}

double Scanner::big_endian_double() {
  std::uint64_t bits = 0;
  for (const char c : bytes(8)) bits = bits << 8 | static_cast<unsigned char>(c);
  double value;
  std::memcpy(&value, &bits, sizeof value);
  return value;
}

bool Scanner::parse_decimal(std::string_view line, std::int64_t& integer) {
  const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), integer);
  if (end != line.data() + line.size() || error == std::errc::invalid_argument) fail("a damaged integer");
  return error == std::errc();
}

double Scanner::parse_float(std::string_view line) {
  double value = 0;
  const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), value);
  if (end != line.data() + line.size() || error != std::errc()) fail("a damaged number");
  return value;
}

std::uint32_t Scanner::digits(std::string_view text, std::size_t first, std::size_t count, int base) {
  std::uint32_t value = 0;
  if (first + count > text.size()) fail("a damaged escape");
  const char* begin = text.data() + first;
  if (std::from_chars(begin, begin + count, value, base).ptr != begin + count) fail("a damaged escape");
  return value;
}

std::string Scanner::unquote(std::string_view line) {
  if (line.size() < 2 || line.front() != line.back() || (line.front() != '\'' && line.front() != '"')) {
    fail("a string without quotes");
  }
  line = line.substr(1, line.size() - 2);
  std::string text;
  for (std::size_t i = 0; i < line.size(); ++i) {
    if (line[i] != '\\') {
      text += line[i];
      continue;
    }
    if (++i == line.size()) fail("a damaged escape");
    constexpr std::string_view kEscapes = "\\'\"nrtabfv";
    constexpr std::string_view kMeaning = "\\'\"\n\r\t\a\b\f\v";
    const std::size_t simple = kEscapes.find(line[i]);
    if (simple != std::string_view::npos) {
      text += kMeaning[simple];
    } else if (line[i] == 'x') {
      text += static_cast<char>(digits(line, i + 1, 2, 16));
      i += 2;
    } else {
      text += static_cast<char>(digits(line, i, 3, 8));
      i += 2;
    }
  }
  return text;
}

std::string Scanner::unescape_unicode(std::string_view line) {
  std::string text;
  for (std::size_t i = 0; i < line.size(); ++i) {
    std::uint32_t character = static_cast<unsigned char>(line[i]);
    if (line[i] == '\\' && i + 1 < line.size() && (line[i + 1] == 'u' || line[i + 1] == 'U')) {
      const std::size_t count = line[i + 1] == 'u' ? 4 : 8;
      character = digits(line, i + 2, count, 16);
      i += 1 + count;
    }
    if (!append_utf8(character, text)) fail("text that is not Unicode");
  }
  return text;
}

void Scanner::check_utf8(std::string_view text) {
  // Re-encoding what was decoded accepts exactly the shortest forms of real characters.
  for (std::size_t i = 0; i < text.size();) {
    const auto first = static_cast<unsigned char>(text[i]);
    const std::size_t length = first < 0x80 ? 1 : first < 0xE0 ? 2 : first < 0xF0 ? 3 : 4;
    if (length == 1) {
      ++i;
      continue;
    }
    if (first < 0xC0 || i + length > text.size()) fail("text that is not UTF-8");
    std::uint32_t character = first & (0xFFu >> (length + 1));
    for (std::size_t k = 1; k < length; ++k)
      character = character << 6 | (static_cast<unsigned char>(text[i + k]) & 0x3Fu);
    std::string encoded;
    if (!append_utf8(character, encoded) || encoded != text.substr(i, length)) fail("text that is not UTF-8");
    i += length;
  }
}

}  // namespace anigen::io::pickle
