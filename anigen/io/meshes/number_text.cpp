#include "anigen/io/meshes/number_text.h"

#include <charconv>
#include <system_error>

#include "anigen/core/error.h"

namespace anigen::io {
namespace {

constexpr std::string_view kBlanks = " \t\r\n\v\f";

template <typename T>
void append_shortest(std::string& text, T value) {
  char digits[32];
  const std::to_chars_result result = std::to_chars(digits, digits + sizeof(digits), value);
  text.append(digits, result.ptr);
}

}  // namespace

bool parse_number(std::string_view token, double& value) {
  if (!token.empty() && token.front() == '+') token.remove_prefix(1);
  if (token.empty() || token.front() == '+') return false;
  const char* end = token.data() + token.size();
  const std::from_chars_result result = std::from_chars(token.data(), end, value);
  return result.ec == std::errc() && result.ptr == end;
}

std::string_view take_token(std::string_view& text) {
  const std::size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) {
    text = {};
    return {};
  }
  const std::size_t end = text.find_first_of(kBlanks, begin);
  const std::string_view token = text.substr(begin, end == std::string_view::npos ? end : end - begin);
  text = end == std::string_view::npos ? std::string_view() : text.substr(end);
  return token;
}

void refuse_utf16(std::string_view bytes, const std::string& file) {
  using std::string_view_literals::operator""sv;
  const std::string_view mark = bytes.substr(0, 2);
  if (mark == "\xFF\xFE"sv || mark == "\xFE\xFF"sv || mark == "<\0"sv || mark == "\0<"sv)
    throw NotSupportedError(file, "byte 0", "text in UTF-16; convert it: iconv -f UTF-16 -t UTF-8");
}

void append_number(std::string& text, float value) { append_shortest(text, value); }
void append_number(std::string& text, double value) { append_shortest(text, value); }

}  // namespace anigen::io
