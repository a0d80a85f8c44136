#pragma once

#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>

namespace anigen {

/// Returns `text` with the ASCII letters A to Z in lower case; other bytes, UTF-8 among them, stay.
std::string lower_case(std::string_view text);

/// Replaces every `from` in `text` by `to`, left to right; what was put in is not searched again. `from` is not empty.
void replace_all(std::string& text, std::string_view from, std::string_view to);

/// The text with each character that `by` names replaced.
std::string replaced_characters(const std::string& text, std::initializer_list<std::pair<char, const char*>> by);

}  // namespace anigen
