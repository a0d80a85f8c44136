#pragma once

#include <string>
#include <string_view>

namespace anigen {

/// Returns `text` with the ASCII letters A to Z in lower case; other bytes, UTF-8 among them, stay.
std::string lower_case(std::string_view text);

/// Replaces every `from` in `text` by `to`, left to right; what was put in is not searched again. `from` is not empty.
void replace_all(std::string& text, std::string_view from, std::string_view to);

}  // namespace anigen
