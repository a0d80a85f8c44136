#pragma once
#include <string>

namespace anigen {

/// An id for a caption: of a long one, such as the SHA-256 of a file, the first eight characters.
inline std::string short_id(const std::string& id) {
  constexpr std::size_t kLongest = 24, kKept = 8;
  return id.size() <= kLongest ? id : id.substr(0, kKept);
}

}  // namespace anigen
