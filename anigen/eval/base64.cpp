#include "anigen/eval/base64.h"

namespace anigen::eval {

std::string base64(const std::vector<std::uint8_t>& bytes) {
  static constexpr char kDigits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t have = bytes.size() - i;
    const unsigned group = static_cast<unsigned>(bytes[i]) << 16 |
                           (have > 1 ? static_cast<unsigned>(bytes[i + 1]) << 8 : 0u) |
                           (have > 2 ? static_cast<unsigned>(bytes[i + 2]) : 0u);
    text += kDigits[group >> 18];
    text += kDigits[group >> 12 & 63];
    text += have > 1 ? kDigits[group >> 6 & 63] : '=';
    text += have > 2 ? kDigits[group & 63] : '=';
  }
  return text;
}

}  // namespace anigen::eval
