#include "anigen/asset/joint_side.h"

#include <cctype>
#include <cstddef>
#include <cstdlib>
#include <utility>

#include "anigen/core/text.h"

namespace anigen {

namespace {

bool is_letter(char c) { return std::isalpha(static_cast<unsigned char>(c)) != 0; }
bool is_digit(char c) { return std::isdigit(static_cast<unsigned char>(c)) != 0; }
bool is_upper(char c) { return std::isupper(static_cast<unsigned char>(c)) != 0; }

/// FBX files of Maya spell a character that is no letter as "FBXASC" and its number in three digits.
std::string without_fbx_escapes(const std::string& name) {
  const std::string mark = "FBXASC";
  std::string text;
  for (std::size_t i = 0; i < name.size(); ++i) {
    const bool escape = name.compare(i, mark.size(), mark) == 0 && i + mark.size() + 3 <= name.size() &&
                        is_digit(name[i + 6]) && is_digit(name[i + 7]) && is_digit(name[i + 8]);
    if (!escape) {
      text += name[i];
      continue;
    }
    text += static_cast<char>(std::atoi(name.substr(i + mark.size(), 3).c_str()) % 128);
    i += mark.size() + 2;
  }
  return text;
}

/// Position and length of the word that tells a side; length 0 without one.
std::pair<std::size_t, std::size_t> side_word(const std::string& name) {
  const auto letter_at = [&name](std::size_t i) { return i < name.size() && is_letter(name[i]); };
  const auto digit_at = [&name](std::size_t i) { return i < name.size() && is_digit(name[i]); };
  const std::string low = lower_case(name);
  for (std::size_t i = 0; i < name.size(); ++i) {
    if ((low[i] != 'l' && low[i] != 'r') || letter_at(i + 1)) continue;
    const bool alone = (i == 0 || (!is_letter(name[i - 1]) && !is_digit(name[i - 1]))) && !digit_at(i + 1);
    if (alone) return {i, 1};
  }
  for (const std::string word : {"left", "right"}) {
    for (std::size_t i = low.find(word); i != std::string::npos; i = low.find(word, i + 1)) {
      // A word within another begins in upper case: HandLeft, but not bright.
      const bool begins = i == 0 || !is_letter(name[i - 1]) || (is_upper(name[i]) && !is_upper(name[i - 1]));
      if (begins) return {i, word.size()};
    }
  }
  for (std::size_t i = 1; i < name.size(); ++i) {  // legL, FinR_03
    const bool ends = is_letter(name[i - 1]) && !is_upper(name[i - 1]) && !letter_at(i + 1);
    if ((name[i] == 'L' || name[i] == 'R') && ends) return {i, 1};
  }
  return {0, 0};
}

}  // namespace

SidedName side_of_name(const std::string& raw) {
  const std::string name = without_fbx_escapes(raw);
  const auto [first, length] = side_word(name);
  SidedName result;
  result.rest = lower_case(name);
  if (length > 0) {
    result.side = result.rest[first] == 'l' ? 1 : -1;
    result.rest.replace(first, length, "*");
  }
  result.stem = result.rest;
  // "pelvis.L_021", "pelvis.R_013"
  std::string& stem = result.stem;
  while (!stem.empty() && is_digit(stem.back())) {
    while (!stem.empty() && is_digit(stem.back())) stem.pop_back();
    if (!stem.empty() && std::string("._-").find(stem.back()) != std::string::npos) stem.pop_back();
  }
  return result;
}

}  // namespace anigen
