#pragma once
#include <algorithm>
#include <cstddef>
#include <functional>
#include <initializer_list>
#include <iterator>
#include <set>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "anigen/core/error.h"

namespace anigen {

/// Returns `text` with the ASCII letters A to Z in lower case; other bytes, UTF-8 among them, stay.
std::string lower_case(std::string_view text);

/// Replaces every `from` in `text` by `to`, left to right; what was put in is not searched again. `from` is not empty.
void replace_all(std::string& text, std::string_view from, std::string_view to);

/// The text with each character that `by` names replaced.
std::string replaced_characters(const std::string& text, std::initializer_list<std::pair<char, const char*>> by);

/// The texts of all items, one after the other. @param text of one item, or a pointer to its member
template <typename Range, typename Text>
std::string joined(const Range& items, std::string_view separator, Text text) {
  std::string line;
  bool first = true;
  for (const auto& item : items) {
    if (!std::exchange(first, false)) line += separator;
    line += std::invoke(text, item);
  }
  return line;
}

/// Words or numbers in one line: "a, b, c".
template <typename Range>
std::string joined(const Range& words, std::string_view separator = ", ") {
  return joined(words, separator, [](const auto& word) {
    if constexpr (std::is_arithmetic_v<std::decay_t<decltype(word)>>) {
      return std::to_string(word);
    } else {
      return std::string(word);
    }
  });
}

/// "a, b, c and 4 more", for a line that must not grow with the number of words.
template <typename Range = std::set<std::string>>
std::string listed(const Range& words, std::size_t most = 3) {
  const std::size_t shown = std::min(words.size(), most);
  const std::string text =
      joined(std::vector<std::string>(words.begin(), std::next(words.begin(), static_cast<std::ptrdiff_t>(shown))));
  return shown == words.size() ? text : text + " and " + std::to_string(words.size() - shown) + " more";
}

/// Values of an enum and their words in files, options and reports.
template <typename Enum>
using Words = std::vector<std::pair<Enum, const char*>>;

/// @pre the value has a word
template <typename Enum>
std::string word_of(const Words<Enum>& words, Enum value) {
  return std::find_if(words.begin(), words.end(), [&](const auto& entry) { return entry.first == value; })->second;
}

/// @param place of the word, for messages @throws InputError listing the words
template <typename Enum>
Enum value_of(const Words<Enum>& words, const std::string& word, const std::string& place) {
  for (const auto& [value, name] : words) {
    if (word == name) return value;
  }
  throw InputError("", place,
                   "'" + word + "' is none of " + joined(words, ", ", &std::pair<Enum, const char*>::second));
}

}  // namespace anigen
