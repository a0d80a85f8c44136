#include "anigen/apps/common/options.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <sstream>
#include <stdexcept>

#include "anigen/apps/common/command_line.h"

namespace anigen {

const OptionRow& option_row(const std::string& name) {
  for (const OptionRow& row : kOptions) {
    if (name == row.name) return row;
  }
  throw std::logic_error("options.h has no row for " + name);
}

std::string spelled(const OptionRow& row) {
  return row.letter == 0 ? row.name : std::string("-") + row.letter + "," + row.name;
}

std::vector<std::string> choices_of(const OptionRow& row) {
  std::vector<std::string> words;
  std::istringstream text(row.value);
  for (std::string word; std::getline(text, word, '|');) words.push_back(word);
  const bool open = words.size() < 2 && row.name != std::string("--emit");
  return open || row.name == std::string("--device") ? std::vector<std::string>() : words;
}

CLI::Option* described_option(CLI::Option* option, const OptionRow& row) {
  option->group(row.group);
  if (row.value[0] != '\0') option->type_name(row.value);
  const std::vector<std::string> words = choices_of(row);
  if (!words.empty()) option->check(one_of(words));
  return option;
}

CLI::Option* add_switch_off(CLI::App& app, const std::string& name, bool& on, const std::string& note) {
  const OptionRow& row = option_row(name);
  CLI::Option* flag = app.add_flag_callback(
      spelled(row), [&on] { on = false; }, row.help + note);
  return described_option(flag, row);
}

namespace {

struct OldName {
  std::string name;
  const OptionRow* row;
  bool one_less;
};

/// @param program as old_names of the table has it: "eval", "merge"
std::vector<OldName> old_names_of(const std::string& program) {
  std::vector<OldName> found;
  for (const OptionRow& row : kOptions) {
    std::istringstream names(row.old_names);
    for (std::string name; names >> name;) {
      const std::size_t colon = name.find(':');
      if (name.substr(0, colon) != program) continue;
      name.erase(0, colon + 1);
      const std::size_t plus = name.find('+');
      found.push_back({name.substr(0, plus), &row, plus != std::string::npos});
    }
  }
  return found;
}

/// "1,3" → "2,4"; anything else stays as it is, for the option's own check to refuse.
std::string plus_one(const std::string& text) {
  std::string result;
  std::istringstream parts(text);
  for (std::string part; std::getline(parts, part, ',');) {
    char* end = nullptr;
    const double value = std::strtod(part.c_str(), &end);
    if (part.empty() || *end != '\0') return text;
    char number[32];
    std::snprintf(number, sizeof number, "%.17g", value + 1);
    result += (result.empty() ? "" : ",") + std::string(number);
  }
  return result;
}

}  // namespace

CurrentWords current_words(const std::string& program, const std::vector<std::string>& words) {
  CurrentWords current{words, {}};
  std::string key = program.substr(program.find('-') + 1);
  if (key == "prepare" && !words.empty() && words.front() == "merge") key = "merge";
  const std::vector<OldName> old_names = old_names_of(key);
  for (std::size_t i = 0; i < words.size() && words[i] != "--"; ++i) {
    const std::size_t equals = words[i].find('=');
    const std::string name = words[i].substr(0, equals);
    const auto old = std::find_if(old_names.begin(), old_names.end(), [&](const OldName& o) { return o.name == name; });
    if (old == old_names.end()) continue;
    std::string value = equals == std::string::npos ? "" : words[i].substr(equals);
    if (old->one_less && !value.empty()) value = "=" + plus_one(value.substr(1));
    if (old->one_less && value.empty()) {
      for (std::size_t k = i + 1; k < words.size() && plus_one(words[k]) != words[k]; ++k)
        current.words[k] = plus_one(words[k]);
    }
    current.words[i] = old->row->name + value;
    current.notices.push_back(name + " is now " + old->row->name +
                              (old->one_less ? ", whose number is the guidance scale, 1 more" : "") +
                              "; the next version does not know the old name");
  }
  return current;
}

}  // namespace anigen
