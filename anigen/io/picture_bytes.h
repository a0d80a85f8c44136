#pragma once
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "anigen/core/error.h"

namespace anigen::io {

/// The bytes of a picture file, read with a bounds check, so that every header can be walked without thinking about
/// its end. Holds references only.
class PictureBytes {
 public:
  PictureBytes(const std::vector<std::uint8_t>& bytes, const std::string& name) : bytes_(bytes), name_(name) {}

  /// @throws InputError naming the byte when the file ends before it; so does little_endian
  std::uint64_t big_endian(std::size_t at, std::size_t count) const {
    std::uint64_t value = 0;
    for (std::size_t i = 0; i < count; ++i) value = value << 8 | byte(at + i);
    return value;
  }
  std::uint64_t little_endian(std::size_t at, std::size_t count) const {
    std::uint64_t value = 0;
    for (std::size_t i = count; i-- > 0;) value = value << 8 | byte(at + i);
    return value;
  }
  bool matches(std::size_t at, std::string_view text) const {
    return at + text.size() <= bytes_.size() &&
           std::equal(text.begin(), text.end(), bytes_.begin() + static_cast<std::ptrdiff_t>(at),
                      [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; });
  }
  std::size_t size() const { return bytes_.size(); }
  [[noreturn]] void truncated(std::size_t at) const {
    throw InputError(name_, "byte " + std::to_string(at), "picture file is cut short");
  }

 private:
  std::uint8_t byte(std::size_t at) const {
    if (at >= bytes_.size()) truncated(at);
    return bytes_[at];
  }
  const std::vector<std::uint8_t>& bytes_;
  const std::string& name_;
};

inline constexpr std::string_view kPngSignature = "\x89PNG\r\n\x1a\n";
inline constexpr std::string_view kJpegSignature = "\xff\xd8\xff";

}  // namespace anigen::io
