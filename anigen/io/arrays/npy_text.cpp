#include "anigen/core/error.h"
#include "anigen/io/arrays/npy.h"

namespace anigen::io {

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
