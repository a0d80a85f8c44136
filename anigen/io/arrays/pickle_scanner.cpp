#include "anigen/io/arrays/pickle_scanner.h"

#include <Eigen/Core>
#include <algorithm>
#include <charconv>

#include "anigen/core/error.h"

namespace anigen::io::pickle {

namespace {

constexpr std::size_t kWindow = std::size_t{1} << 18;  // read at once from a source

}  // namespace

/// Makes `count` more bytes lie in the window.
void Scanner::fetch(std::size_t count) {
  window_.erase(0, at_);
  base_ += at_;
  at_ = 0;
  const std::size_t there = window_.size();
  const std::uint64_t wanted = std::min<std::uint64_t>(std::max(count, kWindow), size() - base_);
  window_.resize(std::max<std::size_t>(there, wanted));
  bytes_->read(base_ + there, window_.data() + there, window_.size() - there);
  input_ = window_;
}

std::string_view Scanner::bytes(std::uint64_t count) {
  if (count > left()) fail("the pickle ends early");
  if (count > input_.size() - at_) fetch(static_cast<std::size_t>(count));
  const std::string_view found = input_.substr(at_, count);
  at_ += count;
  return found;
}

void Scanner::skip(std::uint64_t count) {
  if (count > left()) fail("the pickle ends early");
  while (count > 0) {
    const std::uint64_t piece = std::min<std::uint64_t>(count, kWindow);
    bytes(piece);
    count -= piece;
  }
}

std::string_view Scanner::line() {
  std::size_t end = input_.find('\n', at_);
  while (end == std::string_view::npos) {
    const std::size_t searched = input_.size() - at_;
    if (searched >= left()) fail("the pickle ends early");
    fetch(2 * searched + 1);
    end = input_.find('\n', at_ + searched);
  }
  const std::string_view found = input_.substr(at_, end - at_);
  at_ = end + 1;
  return found;
}

double Scanner::big_endian_double() {
  std::uint64_t bits = 0;
  for (const char c : bytes(8)) bits = bits << 8 | static_cast<unsigned char>(c);
  return Eigen::numext::bit_cast<double>(bits);
}

bool Scanner::parse_decimal(std::string_view line, std::int64_t& integer) const {
  const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), integer);
  if (end != line.data() + line.size() || error == std::errc::invalid_argument) fail("a damaged integer");
  return error == std::errc();
}

double Scanner::parse_float(std::string_view line) const {
  double value = 0;
  const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), value);
  if (end != line.data() + line.size() || error != std::errc()) fail("a damaged number");
  return value;
}

std::string Scanner::unquote(std::string_view line) const {
  if (line.size() < 2 || line.front() != line.back() || (line.front() != '\'' && line.front() != '"'))
    fail("a string without quotes");
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

std::string Scanner::unescape_unicode(std::string_view line) const {
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

void Scanner::check_utf8(std::string_view text) const {
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

std::string Scanner::place() const {
  return source_.member + ", byte " + std::to_string(source_.first_byte + instruction_);
}

void Scanner::fail(const std::string& problem) const { throw InputError(source_.file, place(), problem); }

std::uint32_t Scanner::digits(std::string_view text, std::size_t first, std::size_t count, int base) const {
  std::uint32_t value = 0;
  if (first + count > text.size()) fail("a damaged escape");
  const char* begin = text.data() + first;
  if (std::from_chars(begin, begin + count, value, base).ptr != begin + count) fail("a damaged escape");
  return value;
}

}  // namespace anigen::io::pickle
