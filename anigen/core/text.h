#pragma once
#include <algorithm>
#include <initializer_list>
#include <string>
#include <string_view>
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
  std::string known;
  for (const auto& [value, name] : words) {
    if (word == name) return value;
    known += (known.empty() ? "" : ", ") + std::string(name);
  }
  throw InputError("", place, "'" + word + "' is none of " + known);
}

}  // namespace anigen
