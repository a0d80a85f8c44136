#include "anigen/io/usd/text.h"

#include <charconv>

#include "anigen/core/config.h"

namespace anigen::io::usd_export {

namespace {

bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '_'; }
bool is_digit(char c) { return c >= '0' && c <= '9'; }
// Of the bytes of a UTF-8 character all but the first.
bool continues_character(char c) { return (static_cast<unsigned char>(c) & 0xC0) == 0x80; }

template <typename T>
std::string shortest(T value) {
  char digits[32];
  const auto result = std::to_chars(digits, digits + sizeof digits, value + T(0));  // -0 becomes 0
  return {digits, result.ptr};
}

}  // namespace

std::string Identifiers::make(std::string_view name, std::string_view fallback) {
  std::string base;
  bool any = false;
  for (const char c : name) {
    if (continues_character(c)) continue;
    const bool valid = is_letter(c) || is_digit(c);
    if (base.empty() && is_digit(c)) base += '_';
    base += valid ? c : '_';
    any = any || (valid && c != '_');
  }
  if (!any) base = fallback;
  std::string identifier = base;
  for (int i = 2; !taken_.insert(identifier).second; ++i) identifier = base + "_" + std::to_string(i);
  return identifier;
}

std::string string_text(const std::string& text) {
  // Names come from foreign files and need not be UTF-8: what is none is replaced, as in JSON.
  const std::string valid =
      Json::parse(Json(text).dump(-1, ' ', false, Json::error_handler_t::replace)).get<std::string>();
  std::string result = "\"";
  for (const char c : valid) {
    if (c == '"' || c == '\\') result += '\\';
    const auto byte = static_cast<unsigned char>(c);
    result += byte < 0x20 || byte == 0x7F ? ' ' : c;
  }
  return result + "\"";
}

std::string number_text(float value) { return shortest(value); }
std::string number_text(double value) { return shortest(value); }

std::string matrix_text(const Eigen::Matrix4d& matrix) {
  std::string text = "(";
  for (Eigen::Index column = 0; column < 4; ++column) {
    if (column > 0) text += ", ";
    text += tuple_text(Eigen::Vector4d(matrix.col(column)));
  }
  return text + ")";
}

}  // namespace anigen::io::usd_export
