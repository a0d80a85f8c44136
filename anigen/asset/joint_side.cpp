#include "anigen/asset/joint_side.h"

#include <cctype>
#include <cstddef>
#include <cstdlib>

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

/// Position and length of the word that tells a side.
std::optional<std::pair<std::size_t, std::size_t>> side_word(const std::string& name) {
  const auto letter_at = [&name](std::size_t i) { return i < name.size() && is_letter(name[i]); };
  for (std::size_t i = 0; i < name.size(); ++i) {
    const bool alone = (i == 0 || (!is_letter(name[i - 1]) && !is_digit(name[i - 1]))) && !letter_at(i + 1) &&
                       (i + 1 == name.size() || !is_digit(name[i + 1]));
    if (alone && std::string("lLrR").find(name[i]) != std::string::npos) return std::pair{i, std::size_t{1}};
  }
  const std::string low = lower_case(name);
  for (const std::string word : {"left", "right"}) {
    for (std::size_t i = low.find(word); i != std::string::npos; i = low.find(word, i + 1)) {
      // A word within another begins in upper case: HandLeft, but not bright.
      const bool begins = i == 0 || !is_letter(name[i - 1]) || (is_upper(name[i]) && !is_upper(name[i - 1]));
      if (begins) return std::pair{i, word.size()};
    }
  }
  return std::nullopt;
}

}  // namespace

std::optional<std::pair<int, std::string>> side_of_name(const std::string& raw) {
  const std::string name = without_fbx_escapes(raw);
  const auto word = side_word(name);
  if (!word) return std::nullopt;
  const char first = lower_case(name)[word->first];
  std::string rest = lower_case(name.substr(0, word->first) + "*" + name.substr(word->first + word->second));
  // Exporters number joints, and the two of a pair differently: "pelvis.L_021", "pelvis.R_013".
  for (std::size_t end = rest.size(); end > 0 && is_digit(rest[end - 1]); end = rest.size()) {
    while (!rest.empty() && is_digit(rest.back())) rest.pop_back();
    if (!rest.empty() && std::string("._-").find(rest.back()) != std::string::npos) rest.pop_back();
  }
  return std::pair{first == 'l' ? 1 : -1, rest};
}

}  // namespace anigen
