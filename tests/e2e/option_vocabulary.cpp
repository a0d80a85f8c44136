// Walks the options of every program: each is a row of the table with one meaning everywhere, every row is used, and
// old names work: option_vocabulary FOLDER_OF_PROGRAMS PROGRAM...
#include <array>
#include <cstdio>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "anigen/apps/common/options.h"
#include "anigen/core/config.h"
#include "tests/e2e/other_program.h"
#include "tests/support/paths.h"

namespace {

using anigen::Json;
using anigen::OptionRow;
using anigen::test::require;

std::string said(const std::string& line, int& status) {
  std::FILE* pipe = ::popen((line + " 2>&1 </dev/null").c_str(), "r");
  require(pipe != nullptr, "cannot start a shell");
  std::string text;
  std::array<char, 4096> piece{};
  for (std::size_t read = 0; (read = std::fread(piece.data(), 1, piece.size(), pipe)) > 0;)
    text.append(piece.data(), read);
  status = ::pclose(pipe);
  return text;
}

/// Meaning of the options of a command and its subcommands, and which names they have.
void walk(const std::string& program, const Json& command, std::set<std::string>& used) {
  std::map<std::string, std::string> by_help;
  for (const Json& option : command.at("options")) {
    const std::string name = option.at("name"), help = option.at("help");
    const OptionRow& row = anigen::option_row(name);
    used.insert(name);
    require(help.rfind(row.help, 0) == 0, program + " " + name + " means '" + help + "', the table says: " + row.help);
    require(option.at("value") == row.value && option.at("group") == row.group, program + " " + name + ": other words");
    std::string& earlier = by_help[help];
    require(earlier.empty(), program + ": " + name + " and " + earlier + " mean the same");
    earlier = name;
    const bool number = option.at("value") == "N" || option.at("value") == "X" || option.at("value") == "X X" ||
                        option.at("value") == "SECONDS";
    require(!number || option.contains("range"), program + " " + name + " takes a number without a range");
  }
  for (const Json& sub : command.at("commands")) walk(program + " " + sub.at("name").get<std::string>(), sub, used);
}

}  // namespace

int main(int argc, char** argv) {
  try {
    require(argc > 2, "usage: option_vocabulary FOLDER_OF_PROGRAMS PROGRAM...");
    const anigen::test::TemporaryFolder folder;
    std::set<std::string> used;
    for (int i = 2; i < argc; ++i) {
      const std::string program = anigen::test::quoted(argv[1]) + "/" + argv[i];
      int status = 0;
      const std::string listing = said(program + " --completion json", status);
      require(status == 0, program + ": no listing: " + listing);
      walk(argv[i], Json::parse(listing), used);
      for (const char* shell : {"bash", "zsh", "fish"})
        require(!said(program + " --completion " + shell, status).empty() && status == 0, "no completion");
      // The script is one that bash can read, and completes what was begun.
      if (said("bash --version", status).empty() || status != 0) continue;
      const std::string function = "_anigen_" + std::string(argv[i]).substr(std::string("anigen-").size());
      const std::string completed =
          said("bash -c 'eval \"$(" + program + " --completion bash)\"; COMP_WORDS=(x --log-level w); COMP_CWORD=2; " +
                   function + " 2>/dev/null; echo ${COMPREPLY[*]}; COMP_WORDS=(x y --verb); " + function +
                   " 2>/dev/null; echo ${COMPREPLY[*]}'",
               status);
      require(status == 0 && completed == "warn\n--verbose\n", program + ": bash completes '" + completed + "'");
      require(said(program + " --man", status).rfind(".TH ANIGEN", 0) == 0 && status == 0,
              program + ": no manual page");
    }
    for (const OptionRow& row : anigen::kOptions)
      require(used.count(row.name) == 1, std::string("no program has ") + row.name);
    std::printf("%zu options of %d programs\n", used.size(), argc - 2);
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "FAILED: %s\n", error.what());
    return 1;
  }
}
