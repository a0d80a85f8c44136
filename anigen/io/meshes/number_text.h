#pragma once
#include <string>
#include <string_view>

namespace anigen::io {

/// A decimal number that fills the whole token, whatever the locale; a leading + is allowed, so are nan and inf.
/// @return false when the token is something else or exceeds a double
bool parse_number(std::string_view token, double& value);

/// The next run of characters that are neither blanks nor line ends, removed from `text`; empty at its end.
std::string_view take_token(std::string_view& text);

/// @throws NotSupportedError when the bytes begin as text in UTF-16 does, naming the command that converts it
void refuse_utf16(std::string_view bytes, const std::string& file);

/// Appends the shortest text that reads back as the same number.
void append_number(std::string& text, float value);
void append_number(std::string& text, double value);

}  // namespace anigen::io
