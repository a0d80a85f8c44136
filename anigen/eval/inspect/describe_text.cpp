#include <algorithm>

#include "anigen/eval/inspect/inspect.h"

namespace anigen::eval {
namespace {

bool plain(const Json& value) { return !value.is_object() && !value.is_array(); }

/// Names come from foreign files and need not be UTF-8, which JSON demands.
std::string compact(const Json& value) { return value.dump(-1, ' ', false, Json::error_handler_t::replace); }

std::string word(const Json& value) { return value.is_string() ? value.get<std::string>() : compact(value); }

/// "a, b, c" for lists of plain values, "k: v, k: v" for objects of plain values; empty when it does not fit a line.
std::string one_line(const Json& value) {
  if (plain(value)) return word(value);
  std::string text;
  for (const auto& [key, item] : value.items()) {
    const bool flat_list = item.is_array() && std::all_of(item.begin(), item.end(), plain);
    if (!plain(item) && !flat_list) return "";
    text += (text.empty() ? "" : ", ") + (value.is_object() ? key + " " : std::string()) +
            (flat_list ? compact(item) : word(item));
  }
  if (text.empty()) return "none";
  return text.size() <= 160 ? text : "";
}

void append(std::string& text, const Json& value, std::size_t indent) {
  const std::string margin(indent, ' ');
  for (const auto& [key, item] : value.items()) {
    const std::string head = margin + (value.is_object() ? key + ": " : std::string("- "));
    const std::string line = one_line(item);
    if (!line.empty() || plain(item)) {
      text += head + line + "\n";
    } else {
      text += head + "\n";
      append(text, item, indent + 2);
    }
  }
}

}  // namespace

std::string to_text(const Json& description) {
  std::string text;
  append(text, description, 0);
  return text;
}

}  // namespace anigen::eval
