#include "anigen/io/tiff_directory.h"

#include <string_view>

namespace anigen::io {
namespace {

using std::string_view_literals::operator""sv;

constexpr std::size_t kEntryBytes = 12;

std::size_t bytes_of_type(std::uint64_t type) {
  switch (type) {
    case 1:
      return 1;
    case 3:
      return 2;
    case 4:
      return 4;
    default:
      return 0;
  }
}

}  // namespace

bool is_tiff(const PictureBytes& in, std::size_t at) {
  return in.matches(at, "II\x2a\0"sv) || in.matches(at, "MM\0\x2a"sv);
}

std::optional<std::uint64_t> tiff_value(const PictureBytes& in, std::size_t at, std::uint64_t tag) {
  const bool little = in.matches(at, "II");
  const auto value = [&](std::size_t place, std::size_t count) {
    return little ? in.little_endian(place, count) : in.big_endian(place, count);
  };
  const std::size_t directory = at + static_cast<std::size_t>(value(at + 4, 4));
  const std::uint64_t entries = value(directory, 2);
  for (std::uint64_t i = 0; i < entries; ++i) {
    const std::size_t entry = directory + 2 + kEntryBytes * static_cast<std::size_t>(i);
    if (value(entry, 2) != tag) continue;
    const std::size_t bytes = bytes_of_type(value(entry + 2, 2));  // tag, type, count, then the value itself
    if (bytes == 0) return std::nullopt;
    return value(entry + 8, bytes);
  }
  return std::nullopt;
}

}  // namespace anigen::io
