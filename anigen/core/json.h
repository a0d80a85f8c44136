#pragma once
#include <cstddef>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>

namespace anigen {

/// JSON that keeps the order of keys, since configs list models in the order that optimisers see them.
using Json = nlohmann::ordered_json;

/// What a text may ask of a parser: recursion overflows the stack, and a parsed value takes 50 bytes and more where
/// its text took two.
struct JsonLimits {
  std::size_t depth = 256;
  std::size_t values = 10'000'000;
};

/// Parses text after checking it against the limits.
/// @param file only for the message @throws InputError with the byte offset
Json parse_json(std::string_view text, const std::string& file, const JsonLimits& limits = {});

/// A key as RFC 6901 writes it inside a JSON pointer: '~' becomes "~0" and '/' becomes "~1".
std::string escaped_for_pointer(const std::string& key);

Json read_json(const std::filesystem::path& path, const JsonLimits& limits = {});

}  // namespace anigen
