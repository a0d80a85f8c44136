#pragma once
#include <cstddef>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

namespace anigen {

/// JSON that keeps the order of keys, since configs list models in the order that optimisers see them.
using Json = nlohmann::ordered_json;

/// Parses text. Nesting deeper than max_depth is refused before a recursive parser could overflow the stack.
/// @param file only for the message @throws InputError with the byte offset
Json parse_json(std::string_view text, const std::string& file, std::size_t max_depth = 256);

/// A key as RFC 6901 writes it inside a JSON pointer: '~' becomes "~0" and '/' becomes "~1".
std::string escaped_for_pointer(const std::string& key);

Json read_json(const std::filesystem::path& path, std::size_t max_depth = 256);

}  // namespace anigen
