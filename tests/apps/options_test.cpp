#include "anigen/apps/common/options.h"

#include <gtest/gtest.h>

#include <cctype>
#include <map>
#include <regex>
#include <set>
#include <sstream>

#include "anigen/apps/common/command_line.h"
#include "anigen/apps/common/shell.h"
#include "anigen/core/files.h"
#include "tests/support/paths.h"

namespace anigen {
namespace {

namespace fs = std::filesystem;
using Words = std::vector<std::string>;

std::set<std::string> known_names() {
  std::set<std::string> names;
  for (const OptionRow& row : kOptions) names.insert(row.name);
  return names;
}

TEST(OptionTable, HasOneRowForEachNameLetterAndMeaning) {
  std::set<std::string> names, meanings;
  std::set<char> letters;
  for (const OptionRow& row : kOptions) {
    EXPECT_TRUE(names.insert(row.name).second) << row.name << " has two rows";
    EXPECT_TRUE(meanings.insert(row.help).second) << row.name << " means the same as another option: " << row.help;
    EXPECT_TRUE(row.letter == 0 || letters.insert(row.letter).second) << row.name << ": -" << row.letter;
    EXPECT_FALSE(std::string(row.help).empty()) << row.name;
    EXPECT_FALSE(std::string(row.group).empty()) << row.name;
    EXPECT_NE(std::string(row.help).back(), '.') << row.name;
    EXPECT_EQ(&option_row(row.name), &row);
  }
  EXPECT_THROW(option_row("--no-such-option"), std::logic_error);
}

TEST(OptionTable, OldNamesLeadToOneOptionOfTheirProgram) {
  std::map<std::string, std::string> meaning;
  for (const OptionRow& row : kOptions) {
    std::istringstream names(row.old_names);
    for (std::string name; names >> name;) {
      EXPECT_TRUE(std::regex_match(name, std::regex("[a-z]+:--[a-z-]+(\\+1)?"))) << name;
      EXPECT_TRUE(meaning.emplace(name, row.name).second) << name << " stood for two options";
    }
  }
  EXPECT_GT(meaning.size(), 50U);
}

TEST(OptionTable, ValueWordsNameTheirChoices) {
  EXPECT_EQ(choices_of(option_row("--precision")), (Words{"fp32", "bf16", "int8"}));
  EXPECT_EQ(choices_of(option_row("--emit")), Words{"slurm"});
  EXPECT_TRUE(choices_of(option_row("--device")).empty());
  EXPECT_TRUE(choices_of(option_row("--output")).empty());
  EXPECT_EQ(spelled(option_row("--output")), "-o,--output");
  EXPECT_EQ(spelled(option_row("--seed")), "--seed");
}

/// Number of times each identifier stands in a text.
std::map<std::string, int> identifiers(const std::string& text) {
  std::map<std::string, int> counts;
  std::string word;
  for (const char c : text + " ") {
    if (std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '_') {
      word += c;
    } else if (!word.empty()) {
      ++counts[word];
      word.clear();
    }
  }
  return counts;
}

// Programs declare no option beside the table, and read what they declare.
TEST(OptionTable, SourcesOfProgramsTakeOptionsFromItAndReadThem) {
  const std::set<std::string> names = known_names();
  std::string everything;
  std::vector<std::pair<std::string, std::string>> programs;
  for (const auto& entry : fs::recursive_directory_iterator(test::source_dir() / "anigen")) {
    if (entry.path().extension() != ".cpp") continue;
    const std::string text = read_file(entry.path());
    everything += text;
    const std::string parent = entry.path().parent_path().filename();
    if (parent == "apps" || entry.path().stem() == "command_line") programs.emplace_back(entry.path().filename(), text);
  }
  const std::map<std::string, int> uses = identifiers(everything);
  // A declaration: `add_option(app, "--run", request.run, …);`, or add("--run", request.run) in a program of its own.
  const std::regex added(
      "\\badd(_option|_switch_off)?\\(\\s*([a-z.]+,\\s*)?\"(-*[A-Za-z-]+)\",\\s*([A-Za-z_.]+)[^;]*;");
  std::set<std::string> found;
  for (const auto& [file, text] : programs) {
    for (const char* raw : {".add_option(", ".add_flag(", "->add_option(", "->add_flag("})
      EXPECT_EQ(text.find(raw), std::string::npos) << file << " declares an option by itself";
    std::vector<std::smatch> hits;
    std::string declarations;
    for (std::sregex_iterator hit(text.begin(), text.end(), added), end; hit != end; ++hit) {
      hits.push_back(*hit);
      declarations += hit->str();
    }
    const std::map<std::string, int> declared = identifiers(declarations);
    for (const std::smatch& hit : hits) {
      const std::string name = hit[3], variable = hit[4], member = variable.substr(variable.rfind('.') + 1);
      found.insert(name);
      EXPECT_EQ(names.count(name), 1U) << file << ": " << name;
      EXPECT_GT(uses.at(member), declared.at(member)) << file << ": nothing reads " << name << " (" << variable << ")";
    }
  }
  EXPECT_GT(found.size(), 150U);
}

TEST(OptionTable, FlagsTurnOffWhatIsOn) {
  bool on = true;
  CLI::App app;
  const CLI::Option* flag = add_switch_off(app, "--no-icp", on, "; with a note");
  EXPECT_EQ(flag->get_group(), option_row("--no-icp").group);
  EXPECT_EQ(flag->get_description(), std::string(option_row("--no-icp").help) + "; with a note");
  app.parse("");
  EXPECT_TRUE(on);
  app.parse("--no-icp --no-icp");
  EXPECT_FALSE(on);
}

TEST(CurrentWords, ReplaceOldNamesOfTheProgramAlone) {
  const CurrentWords eval = current_words(
      "anigen-eval", {"--gt", "rigs", "--out=results", "--guidance", "1,3", "0.5", "--pred", "--x", "--", "--out"});
  EXPECT_EQ(eval.words, (Words{"--dataset", "rigs", "--output=results", "--ss-guidance", "2,4", "1.5", "--pred", "--x",
                               "--", "--out"}));
  EXPECT_EQ(eval.notices.size(), 3U);
  EXPECT_NE(eval.notices[2].find("--guidance is now --ss-guidance"), std::string::npos) << eval.notices[2];
  EXPECT_EQ(current_words("anigen-train", {"--out", "x"}).words, (Words{"--out", "x"}));
  EXPECT_EQ(current_words("anigen-prepare", {"merge", "--out", "x"}).words, (Words{"merge", "--dataset", "x"}));
  EXPECT_EQ(current_words("anigen-prepare", {"--out", "merge"}).words, (Words{"--output", "merge"}));
  EXPECT_EQ(current_words("anigen-generate", {"--cfg-scale=7.5", "--cfg-scale-ss", "many"}).words,
            (Words{"--slat-guidance=8.5", "--ss-guidance", "many"}));
  const Words today{"-o", "x", "--dataset", "y"};
  EXPECT_EQ(current_words("anigen-eval", today).words, today);
  EXPECT_TRUE(current_words("anigen-eval", today).notices.empty());
}

/// A program with a flag, choices, a path, a number, and a subcommand.
struct Sample : Program {
  Sample() : Program("anigen-sample", "Does a thing: well.\n.And more.", "  anigen-sample -o x") {
    add_option(app, "--output", output)->required();
    add_option(app, "--precision", precision);
    add_option(app, "--limit", limit)->check(whole_number(0, 9));
    CLI::App& sub = command("merge", "Merges");
    add_option(sub, "--dataset", dataset);
    add_common({"--seed", "--device", "--json", "--keep-going"});
  }
  int call(Words words) {
    words.insert(words.begin(), "anigen-sample");
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    return run(static_cast<int>(argv.size()), argv.data(), [this] { ran = true; });
  }
  std::string output, precision = "fp32", dataset;
  int limit = 3;
  bool ran = false;
};

TEST(Program, ReadsShortFormsAndRefusesWhatItDoesNotKnow) {
  Sample good;
  EXPECT_EQ(good.call({"-o", "x", "-n", "4", "-k", "--seed", "7", "-q"}), 0);
  EXPECT_TRUE(good.ran);
  EXPECT_EQ(good.output, "x");
  EXPECT_EQ(good.limit, 4);
  EXPECT_EQ(good.common.seed, 7U);
  EXPECT_TRUE(good.common.keep_going && good.common.quiet);
  EXPECT_FALSE(Sample().common.seed.has_value());
  for (const Words& words : std::vector<Words>{{"-o", "x", "--outptu", "y"},
                                               {"-o", "x", "--threads", "2"},
                                               {"-o", "x", "stray"},
                                               {"-o", "x", "--precision", "fp8"},
                                               {"-o", "x", "-n", "10"},
                                               {"-o", "x", "--device", "gpu"},
                                               {"-o", "x", "-q", "-v"},
                                               {}}) {
    Sample bad;
    EXPECT_EQ(bad.call(words), 2);
    EXPECT_FALSE(bad.ran);
  }
}

TEST(Program, SomeFailedInputsAreAFailureUnlessToldToKeepGoing) {
  CommonOptions common;
  EXPECT_NO_THROW(require_inputs(0, 3, "failed", common));
  EXPECT_THROW(require_inputs(1, 3, "failed", common), Error);
  common.keep_going = true;
  EXPECT_NO_THROW(require_inputs(2, 3, "failed", common));
  EXPECT_THROW(require_inputs(3, 3, "failed", common), Error);
}

TEST(Shell, ListsOptionsWithRangesAndChoices) {
  Sample sample;
  const Json listing = command_listing(sample.app);
  std::map<std::string, Json> options;
  for (const Json& option : listing["options"]) options[option["name"]] = option;
  EXPECT_EQ(options.at("--limit")["range"], "0..9");
  EXPECT_EQ(options.at("--limit")["default"], "3");
  EXPECT_EQ(options.at("--limit")["letter"], "n");
  EXPECT_EQ(options.at("--precision")["choices"], Json({"fp32", "bf16", "int8"}));
  EXPECT_EQ(options.at("--output")["required"], true);
  EXPECT_EQ(listing["commands"][0]["name"], "merge");
  for (const char* shell : {"bash", "zsh", "fish"}) {
    const std::string script = completion(sample.app, shell);
    for (const char* word : {"precision", "fp32 bf16", "merge", "dataset"})
      EXPECT_NE(script.find(word), std::string::npos) << shell << ": " << word << "\n" << script;
  }
  EXPECT_EQ(completion(sample.app, "tcsh"), "");
}

TEST(Shell, ManualPageEscapesRequestsAndHyphens) {
  Sample sample;
  const std::string page = man_page(sample.app);
  for (const char* text : {".TH ANIGEN-SAMPLE 1", ".SH NAME\nanigen\\-sample \\- Does a thing\n", "\n\\&.And more.",
                           "\\fB\\-o\\fR, \\fB\\-\\-output\\fR \\fIPATH\\fR", ".SH COMMAND merge", ".SS Output",
                           "anigen\\-sample \\-o x", ".SH EXIT STATUS"})
    EXPECT_NE(page.find(text), std::string::npos) << text << "\n" << page;
}

TEST(NamedWord, MayStandAnywhereButBehindAnOptionThatTakesIt) {
  CLI::App app;
  std::string text;
  std::vector<double> pair;
  std::vector<std::string> several;
  bool flag = false;
  app.add_option("-m,--mesh", text);
  app.add_option("-o,--output", text);
  app.add_option("--pair", pair)->expected(2);
  app.add_option("--one-or-two", several)->expected(1, 2);
  app.add_flag("-q,--quiet", flag);
  const auto named = [&](const Words& words) { return with_named_word(app, words, "--mesh"); };
  const Words cases[] = {
      {"^a.glb"},
      {"-q", "^a.glb", "-o", "b"},
      {"-o", "b", "^a.glb"},
      {"-ob", "^a.glb"},
      {"--output=b", "^a.glb"},
      {"--pair", "-1", "2", "^a.glb"},
      {"--one-or-two", "x", "-q", "^a.glb"},
      {"--one-or-two", "x", "y", "^a.glb"},
      {"-m", "a.glb"},
      {"--output"},
      {"--unknown", "^a.glb"},
      {"--", "a.glb"},
      {},
  };
  for (const Words& marked : cases) {
    Words words, expected;
    for (const std::string& word : marked) {
      const bool is_named = word[0] == '^';
      if (is_named) expected.push_back("--mesh");
      words.push_back(word.substr(is_named ? 1 : 0));
      expected.push_back(words.back());
    }
    EXPECT_EQ(named(words), expected);
  }
}

}  // namespace
}  // namespace anigen
