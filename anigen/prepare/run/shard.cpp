#include "anigen/prepare/run/shard.h"

#include <charconv>
#include <optional>

#include "anigen/core/error.h"

namespace anigen::prepare {
namespace {

/// @return nothing unless the whole text is a number
std::optional<std::size_t> number(const std::string& text) {
  std::size_t value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || text.empty()) return std::nullopt;
  return value;
}

}  // namespace

Shard parse_shard(const std::string& text) {
  const std::size_t slash = text.find('/');
  if (slash != std::string::npos) {
    const auto index = number(text.substr(0, slash)), count = number(text.substr(slash + 1));
    if (index && count && *index < *count) return {*index, *count};
  }
  throw InputError("", "--shard", "must be i/n with 0 <= i < n, got \"" + text + "\"");
}

}  // namespace anigen::prepare
