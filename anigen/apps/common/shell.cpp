#include "anigen/apps/common/shell.h"

#include <algorithm>
#include <cctype>
#include <sstream>

#include "anigen/apps/common/options.h"
#include "anigen/core/text.h"
#include "anigen/core/version.h"

namespace anigen {

namespace {

bool is_path(const std::string& value) {
  return value.find("FILE") != std::string::npos || value.find("PATH") == 0 || value == "[NAME=]PATH" || value == "DIR";
}

Json listed(const CLI::Option& option) {
  std::string name = option.get_name();  // of a positional its own, else "--name" or "-l,--name"
  if (!option.get_lnames().empty()) name = "--" + option.get_lnames().front();
  const OptionRow& row = option_row(name);
  Json json = {{"name", name}, {"value", row.value}, {"group", row.group}, {"help", option.get_description()}};
  if (row.letter != 0) json["letter"] = std::string(1, row.letter);
  std::vector<std::string> choices = choices_of(row);
  if (name == "--device") choices = {"cpu", "cuda"};
  if (!choices.empty()) json["choices"] = choices;
  const std::string type = option.get_type_name();
  const std::size_t colon = type.rfind(':');
  if (colon != std::string::npos && type.substr(0, colon) == row.value) json["range"] = type.substr(colon + 1);
  if (!option.get_default_str().empty()) json["default"] = option.get_default_str();
  json["required"] = option.get_required();
  json["repeatable"] = option.get_expected_max() > 2;
  return json;
}

std::string with(std::string text, char from, char to) {
  std::replace(text.begin(), text.end(), from, to);
  return text;
}

/// Options of a command line and of all its subcommands, each name once.
std::vector<Json> all_options(const Json& listing) {
  std::vector<Json> options(listing["options"].begin(), listing["options"].end());
  for (const Json& command : listing["commands"]) {
    for (const Json& option : command["options"]) {
      const auto same = [&](const Json& other) { return other["name"] == option["name"]; };
      if (std::none_of(options.begin(), options.end(), same)) options.push_back(option);
    }
  }
  return options;
}

std::string join(const Json& words, const std::string& between) {
  return joined(words, between, [](const Json& word) { return word.get<std::string>(); });
}

bool positional(const Json& option) { return option["name"].get<std::string>()[0] != '-'; }

/// "--output" and, where there is one, "-o", with what is between.
std::string names_of(const Json& option, const std::string& between) {
  const std::string letter = option.value("letter", "");
  return option["name"].get<std::string>() + (letter.empty() ? "" : between + "-" + letter);
}

std::string function_name(const Json& listing) { return "_" + with(listing["name"], '-', '_'); }

/// Options of a subcommand, with those of the program that go with it: all where a command is required, else those
/// about messages.
std::vector<Json> with_shared(const Json& command, const Json& program) {
  std::vector<Json> options(command["options"].begin(), command["options"].end());
  for (const Json& option : program["options"]) {
    if (positional(option) || option["name"] == "--help") continue;
    if (program["command_required"] == true || option["group"] == "Messages and help") options.push_back(option);
  }
  return options;
}

std::string offered(const std::vector<Json>& options) {
  std::string words;
  for (const Json& option : options)
    if (!positional(option)) words += (words.empty() ? "" : " ") + names_of(option, " ");
  return words;
}

std::string bash_completion(const Json& listing) {
  const std::string function = function_name(listing), name = listing["name"];
  std::string text = "# Completion of " + name + " for bash: eval \"$(" + name + " --completion bash)\"\n" + function +
                     "() {\n  local word=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]} words\n"
                     "  COMPREPLY=()\n  case $before in\n";
  for (const Json& option : all_options(listing)) {
    if (positional(option) || option["value"] == "") continue;
    text += "    " + names_of(option, "|") + ") ";
    if (option.contains("choices")) {
      text += "COMPREPLY=($(compgen -W '" + join(option["choices"], " ") + "' -- \"$word\"))";
    } else if (is_path(option["value"])) {
      text += std::string("compopt -o filenames; COMPREPLY=($(compgen ") + (option["value"] == "DIR" ? "-d" : "-f") +
              " -- \"$word\"))";
    } else {
      text += ":";
    }
    text += "; return ;;\n";
  }
  text += "  esac\n  words='" + offered(listing["options"]) + "'\n";
  if (!listing["commands"].empty()) {
    std::string commands;
    for (const Json& command : listing["commands"]) {
      const std::string word = command["name"];
      commands += (commands.empty() ? "" : " ") + word;
      text += "  [[ \" ${COMP_WORDS[*]:1:COMP_CWORD-1} \" == *' " + word + " '* ]] && words='" +
              offered(with_shared(command, listing)) + "'\n";
    }
    text += "  (( COMP_CWORD == 1 )) && words+=' " + commands + "'\n";
  }
  text +=
      "  if [[ $word == -* || $COMP_CWORD == 1 ]]; then COMPREPLY=($(compgen -W \"$words\" -- \"$word\")); fi\n"
      "  if [[ $word != -* && ${#COMPREPLY[@]} == 0 ]]; then compopt -o filenames; COMPREPLY=($(compgen -f -- "
      "\"$word\")); fi\n}\n";
  return text + "complete -F " + function + " " + name + "\n";
}

// The beginning of a help text, without what would end single quotes of a shell or a description in brackets.
std::string brief(const Json& option) {
  const std::string help = option["help"];
  std::string text;
  for (const char c : help.substr(0, help.find_first_of(".;[]"))) {
    if (c == '\'') {
      text += "’";
    } else {
      text += c == ':' ? ',' : c;
    }
  }
  return text.substr(0, text.find_last_not_of(" ,") + 1);
}

std::string zsh_arguments(const std::vector<Json>& options) {
  std::string text;
  for (const Json& option : options) {
    std::string action;
    if (option.contains("choices"))
      action = ":value:(" + join(option["choices"], " ") + ")";
    else if (is_path(option["value"]))
      action = option["value"] == "DIR" ? ":folder:_files -/" : ":file:_files";
    else if (option["value"] != "")
      action = ":" + with(option["value"], ':', ' ') + ": ";
    if (positional(option)) {
      text += " \\\n    '*:file:_files'";
      continue;
    }
    const std::string tail = "[" + brief(option) + "]" + action + "'";
    text += " \\\n    '*" + option["name"].get<std::string>() + tail;
    if (option.contains("letter")) text += " \\\n    '*-" + option["letter"].get<std::string>() + tail;
  }
  return text;
}

std::string zsh_completion(const Json& listing) {
  const std::string name = listing["name"], function = function_name(listing);
  std::string text = "#compdef " + name + "\n" + function + "() {\n";
  if (!listing["commands"].empty()) {
    text += "  local -a commands=(";
    for (const Json& command : listing["commands"])
      text += "'" + command["name"].get<std::string>() + ":" + brief(command) + "' ";
    text += ")\n  (( CURRENT == 2 )) && _describe command commands\n  case $words[2] in\n";
    for (const Json& command : listing["commands"]) {
      text += "  " + command["name"].get<std::string>() + ") shift words; (( CURRENT-- ))\n  _arguments" +
              zsh_arguments(with_shared(command, listing)) + "; return ;;\n";
    }
    text += "  esac\n";
  }
  return text + "  _arguments" + zsh_arguments(listing["options"]) + "\n}\ncompdef " + function + " " + name + "\n";
}

std::string fish_completion(const Json& listing) {
  const std::string name = listing["name"];
  std::string text = "# Completion of " + name + " for fish: " + name + " --completion fish | source\n";
  const auto add = [&](const Json& options, const std::string& condition) {
    for (const Json& option : options) {
      if (positional(option)) continue;
      text += "complete -c " + name + condition + " -l " + option["name"].get<std::string>().substr(2);
      if (option.contains("letter")) text += " -s " + option["letter"].get<std::string>();
      if (option.contains("choices"))
        text += " -x -a '" + join(option["choices"], " ") + "'";
      else if (option["value"] != "")
        text += is_path(option["value"]) ? " -r" : " -x";
      text += " -d '" + brief(option) + "'\n";
    }
  };
  add(listing["options"], "");
  for (const Json& command : listing["commands"]) {
    const std::string word = command["name"];
    text += "complete -c " + name + " -n __fish_use_subcommand -a " + word + " -d '" + brief(command) + "'\n";
    add(command["options"], " -n '__fish_seen_subcommand_from " + word + "'");
  }
  return text;
}

/// Options in the order of the table's groups; help and messages last.
std::vector<std::pair<std::string, std::vector<Json>>> grouped(const std::vector<Json>& options) {
  std::vector<std::pair<std::string, std::vector<Json>>> groups;
  for (const OptionRow& row : kOptions) {
    if (groups.empty() || groups.back().first != row.group) groups.emplace_back(row.group, std::vector<Json>());
    for (const Json& option : options)
      if (option["name"] == row.name) groups.back().second.push_back(option);
  }
  groups.erase(std::remove_if(groups.begin(), groups.end(), [](const auto& group) { return group.second.empty(); }),
               groups.end());
  return groups;
}

/// Help of an option with its range and default.
std::string full_help(const Json& option) {
  std::string text = option["help"];
  if (option.contains("range")) text += " (" + option["range"].get<std::string>() + ")";
  if (option.contains("default")) text += " [" + option["default"].get<std::string>() + "]";
  return option["required"] == true ? text + "; required" : text;
}

/// Appends words in lines of at most 100 characters that begin in a column; the first goes on behind `line`.
void add_wrapped(std::string line, const std::string& text, std::size_t column, std::string& out) {
  constexpr std::size_t kWidth = 100;
  if (line.size() + 1 > column) {
    out += line + "\n";
    line.clear();
  }
  line.resize(column, ' ');
  std::istringstream words(text);
  bool fresh = true;
  for (std::string word; words >> word;) {
    if (!fresh && line.size() + 1 + word.size() > kWidth) {
      out += line + "\n";
      line.assign(column, ' ');
      fresh = true;
    }
    line += (fresh ? "" : " ") + word;
    fresh = false;
  }
  out += line + "\n";
}

/// Text for roff: no escapes, no requests at the start of a line.
std::string roff(const std::string& text) {
  std::string safe;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    const bool starts_line = i == 0 || text[i - 1] == '\n';
    if (starts_line && (c == '.' || c == '\'')) safe += "\\&";
    safe += c == '\\' ? "\\e" : c == '-' ? "\\-" : std::string(1, c);
  }
  return safe;
}

void add_roff_options(const Json& command, std::string& text) {
  for (const auto& [group, members] : grouped({command["options"].begin(), command["options"].end()})) {
    text += ".SS " + group + "\n";
    for (const Json& option : members) {
      text += ".TP\n";
      if (option.contains("letter")) text += "\\fB\\-" + option["letter"].get<std::string>() + "\\fR, ";
      text += "\\fB" + roff(option["name"]) + "\\fR";
      if (option["value"] != "" && !positional(option)) text += " \\fI" + roff(option["value"]) + "\\fR";
      text += "\n" + roff(full_help(option)) + "\n";
    }
  }
}

}  // namespace

Json command_listing(const CLI::App& app) {
  Json json = {{"name", app.get_name()},
               {"help", app.get_description()},
               {"options", Json::array()},
               {"commands", Json::array()}};
  json["command_required"] = app.get_require_subcommand_min() > 0;
  for (const CLI::Option* option : app.get_options()) json["options"].push_back(listed(*option));
  for (const CLI::App* command : app.get_subcommands(nullptr)) json["commands"].push_back(command_listing(*command));
  return json;
}

std::string help_text(const CLI::App& app) {
  const CLI::App* parent = app.get_parent();
  const Json listing = command_listing(app);
  std::string text = "Usage: " + (parent == nullptr ? "" : parent->get_name() + " ") + app.get_name();
  if (app.get_require_subcommand_min() > 0) text += " COMMAND";
  text += " [options]";
  std::vector<Json> options(listing["options"].begin(), listing["options"].end());
  for (const Json& option : options)
    if (positional(option))
      text += " " + option["value"].get<std::string>() + (option["repeatable"] == true ? "..." : "");
  text += "\n\n" + app.get_description() + (app.get_description().back() == '.' ? "\n" : ".\n");
  constexpr std::size_t kNames = 14, kColumn = 30;
  if (!listing["commands"].empty()) text += "\nCommands (each has its --help):\n";
  for (const Json& command : listing["commands"])
    add_wrapped("  " + command["name"].get<std::string>(), command["help"], kNames, text);
  if (parent != nullptr) options = with_shared(listing, command_listing(*parent));
  for (const auto& [group, members] : grouped(options)) {
    text += "\n" + group + ":\n";
    for (const Json& option : members) {
      const std::string letter = option.value("letter", ""), value = option["value"];
      std::string names = letter.empty() ? "      " : "  -" + letter + ", ";
      if (positional(option)) names = "  ";
      names += option["name"].get<std::string>() + (value.empty() || positional(option) ? "" : " " + value);
      add_wrapped(names, full_help(option), kColumn, text);
    }
  }
  const std::string examples = (parent == nullptr ? app : *parent).get_footer();
  return text + (examples.empty() ? "" : "\n" + examples + "\n");
}

std::string completion(const CLI::App& app, const std::string& shell) {
  const Json listing = command_listing(app);
  if (shell == "bash") return bash_completion(listing);
  if (shell == "zsh") return zsh_completion(listing);
  if (shell == "fish") return fish_completion(listing);
  return shell == "json" ? listing.dump(2) + "\n" : "";
}

std::string man_page(const CLI::App& app) {
  const Json listing = command_listing(app);
  const std::string name = listing["name"], help = listing["help"];
  std::string upper = name;
  std::transform(upper.begin(), upper.end(), upper.begin(), [](unsigned char c) { return std::toupper(c); });
  const std::string first = help.substr(0, help.find_first_of(".:"));
  std::string text = ".TH " + upper + " 1 \"\" \"AniGen " + kVersion + "\" \"AniGen\"\n.SH NAME\n" + roff(name) +
                     " \\- " + roff(with(first, '\n', ' ')) + "\n.SH SYNOPSIS\n";
  for (const Json& command : listing["commands"])
    text += ".B " + roff(name) + " " + roff(command["name"]) + "\n[options]\n.br\n";
  const bool alone = listing["commands"].empty() || name == "anigen-prepare";
  if (alone) text += ".B " + roff(name) + "\n[options]\n";
  text += ".SH DESCRIPTION\n" + roff(help) + "\n";
  for (const Json& command : listing["commands"]) {
    text += ".SH COMMAND " + roff(command["name"]) + "\n" + roff(command["help"]) + "\n";
    add_roff_options(command, text);
  }
  text += ".SH OPTIONS\n";
  add_roff_options(listing, text);
  std::string examples = app.get_footer();
  examples.erase(0, std::min(examples.size(), std::string("Examples:\n").size()));
  return text + ".SH EXAMPLES\n.nf\n" + roff(examples) +
         "\n.fi\n.SH EXIT STATUS\n0: done. 1: the run failed, or some of its inputs did. 2: bad input. 130: "
         "interrupted, "
         "after saving.\n";
}

}  // namespace anigen
