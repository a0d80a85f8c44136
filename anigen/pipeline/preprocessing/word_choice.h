#pragma once
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"

namespace anigen::pipeline {

/// What a word on the command line stands for. @throws InputError naming the option and listing its words
template <typename Choice>
Choice chosen(const std::string& option, const std::string& word,
              const std::vector<std::pair<std::string, Choice>>& choices) {
  std::string words;
  for (const auto& [known, choice] : choices) {
    if (known == word) return choice;
    words += (words.empty() ? "" : ", ") + known;
  }
  throw InputError("", option, "'" + word + "' is none of: " + words);
}

}  // namespace anigen::pipeline
