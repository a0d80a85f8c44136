#pragma once
#include <cstdint>
#include <string>
#include <vector>

namespace anigen::eval {

/// RFC 4648 with padding, for pictures inside HTML.
std::string base64(const std::vector<std::uint8_t>& bytes);

}  // namespace anigen::eval
