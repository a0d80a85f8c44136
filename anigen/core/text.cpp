#include "anigen/core/text.h"

namespace anigen {

std::string lower_case(std::string_view text) {
  std::string lower(text);
  for (char& c : lower)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return lower;
}

void replace_all(std::string& text, std::string_view from, std::string_view to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
    text.replace(at, from.size(), to);
}

std::string replaced_characters(const std::string& text, std::initializer_list<std::pair<char, const char*>> by) {
  std::string result;
  for (const char c : text) {
    const auto found = std::find_if(by.begin(), by.end(), [c](const auto& entry) { return entry.first == c; });
    if (found == by.end()) {
      result += c;
    } else {
      result += found->second;
    }
  }
  return result;
}

}  // namespace anigen
