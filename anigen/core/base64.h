#pragma once
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace anigen {

/// RFC 4648 with padding, for buffers inside JSON and pictures inside HTML.
std::string base64(std::string_view bytes);
std::string base64(const std::vector<std::uint8_t>& bytes);

}  // namespace anigen
