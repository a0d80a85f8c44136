#pragma once
#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"

namespace anigen {

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
