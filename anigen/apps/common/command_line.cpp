#include "anigen/apps/common/command_line.h"

#include <algorithm>
#include <exception>
#include <new>
#include <utility>

#include "anigen/apps/common/shell.h"
#include "anigen/core/error.h"
#include "anigen/core/kernel_form.h"
#include "anigen/core/log.h"
#include "anigen/core/openblas.h"
#include "anigen/core/parallel.h"
#include "anigen/core/process.h"
#include "anigen/core/version.h"

namespace anigen {

namespace {

/// Long options of a command and of those above it.
std::vector<std::string> known_options(const CLI::App* app) {
  std::vector<std::string> names;
  for (; app != nullptr; app = app->get_parent()) {
    for (const CLI::Option* option : app->get_options())
      for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
  }
  return names;
}

void print_unexpected(const CLI::App& program) {
  const CLI::App* command = &program;
  while (!command->get_subcommands().empty()) command = command->get_subcommands().front();
  for (const std::string& word : program.remaining(true)) {
    const std::string name = word.substr(0, word.find('='));
    if (name.empty() || name[0] != '-') {
      std::fprintf(stderr, "error: '%s': %s expects no such word\n", word.c_str(), program.get_name().c_str());
      return;
    }
    const std::string nearest = nearest_word(name, known_options(command));
    std::fprintf(stderr, "error: %s: %s has no such option%s\n", name.c_str(), program.get_name().c_str(),
                 nearest.empty() ? "" : ("; did you mean " + nearest + "?").c_str());
    return;
  }
}

}  // namespace

Program::Program(const std::string& name, const std::string& purpose, const std::string& examples)
    : app(purpose, name) {
  app.footer("Examples:\n" + examples);
  app.formatter_fn(
      [](const CLI::App* described, const std::string&, CLI::AppFormatMode) { return help_text(*described); });
  const OptionRow help = option_row("--help");
  app.set_help_flag(spelled(help), help.help)->group(help.group);
}

CLI::App& Program::command(const std::string& name, const std::string& purpose) {
  CLI::App* command = app.add_subcommand(name, purpose);
  command->fallthrough();
  command->get_help_ptr()->group(option_row("--help").group);
  return *command;
}

std::vector<std::string> with_named_word(const CLI::App& app, std::vector<std::string> words, const std::string& name) {
  const auto is_option = [&](std::size_t at) { return words[at].size() > 1 && words[at][0] == '-'; };
  for (std::size_t i = 0; i < words.size() && words[i] != "--"; ++i) {
    if (!is_option(i)) {
      words.insert(words.begin() + static_cast<std::ptrdiff_t>(i), name);
      return words;
    }
    const bool is_long = words[i][1] == '-';
    const CLI::Option* option = app.get_option_no_throw(is_long ? words[i] : words[i].substr(0, 2));
    if (option == nullptr || option->get_items_expected_max() == 0) continue;  // --name=value, or takes none
    if (!is_long && words[i].size() > 2) continue;                             // -oPATH
    for (int taken = 0; taken < option->get_items_expected_max() && i + 1 < words.size(); ++taken, ++i)
      if (taken >= option->get_items_expected_min() && is_option(i + 1)) break;
  }
  return words;
}

void Program::add_common(const std::vector<std::string>& names, std::function<std::string()> version_details) {
  for (const std::string& text : names) {
    const std::string name = text.substr(0, text.find(' ')), note = text.substr(name.size());
    if (name == "--seed") add_option(app, name, common.seed, note)->check(whole_number(0));
    if (name == "--threads") add_option(app, name, common.threads)->check(whole_number(0, 4096));
    if (name == "--device") add_option(app, name, common.device)->check(device_name());
    if (name == "--json") add_option(app, name, common.json);
    if (name == "--keep-going") add_option(app, name, common.keep_going);
  }
  CLI::Option* quiet = add_option(app, "--quiet", common.quiet);
  CLI::Option* verbose = add_option(app, "--verbose", common.verbose)->excludes(quiet);
  add_option(app, "--log-level", common.log_level)->excludes(verbose);
  add_option(app, "--check-options", check_options_);
  add_option(app, "--completion", completion_);
  add_option(app, "--man", man_);
  const OptionRow version = option_row("--version");
  app.set_version_flag(
         spelled(version),
         [details = std::move(version_details)] {
           std::string text = "anigen " + named_version();
           text += "\n" + kernel_form_details() + "; " + openblas_details();
           if (details) text += "\n" + details();
           return text;
         },
         version.help)
      ->group(version.group);
}

int Program::run(int argc, char** argv, const std::function<void()>& body) {
  start_with_openblas_core(argv);
  CurrentWords current = current_words(app.get_name(), {argv + 1, argv + argc});
  if (!first.empty()) current.words = with_named_word(app, current.words, first);
  words = {argv, argv + 1};
  words.insert(words.end(), current.words.begin(), current.words.end());
  for (std::size_t i = 1; i < words.size() && words[i] != "--"; ++i) {
    // Ahead of everything else, which may be required and is not needed for these.
    if (words[i] == "--man") return std::fputs(man_page(app).c_str(), stdout) < 0 ? 1 : 0;
    if (words[i] != "--completion" || i + 1 == words.size()) continue;
    const std::string script = completion(app, words[i + 1]);
    if (!script.empty()) return std::fputs(script.c_str(), stdout) < 0 ? 1 : 0;
  }
  try {
    kernel_form();  // refuses what ANIGEN_KERNELS says before anything else
    std::reverse(current.words.begin(), current.words.end());
    app.parse(current.words);
  } catch (const InputError& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 2;
  } catch (const CLI::ExtrasError&) {
    print_unexpected(app);
    return 2;
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  const std::string printed = man_ ? man_page(app) : completion_.empty() ? "" : completion(app, completion_);
  if (!printed.empty()) return std::fputs(printed.c_str(), stdout) < 0 ? 1 : 0;
  try {
    std::string level = common.log_level;
    if (common.verbose) level = "debug";
    if (common.quiet && level == "info") level = "warn";
    log::setup(level);
    for (const std::string& notice : current.notices) log::warn("{}", notice);
    Progress::set_quiet(common.quiet);
    set_thread_count(common.threads);
    install_interrupt_handler();
    if (check) check();
    if (!check_options_) body();
    return 0;
  } catch (const InputError& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 2;
  } catch (const Interrupted& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 130;
  } catch (const std::bad_alloc&) {
    std::fprintf(stderr, "error: out of memory\n");
    return 1;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
  }
}

void refuse_given(const CLI::App& app, const std::vector<std::string>& names, const std::string& reason) {
  for (const std::string& name : names) {
    if (app.get_option(name)->count() > 0) throw InputError("", name, reason);
  }
}

void print_result(const Json& json, const std::string& text, const CommonOptions& common) {
  std::fputs(common.json ? (json.dump(2) + "\n").c_str() : text.c_str(), stdout);
}

void require_inputs(std::size_t failed, std::size_t all, const std::string& what, const CommonOptions& common) {
  if (failed == 0 || (common.keep_going && failed < all)) return;
  throw Error(std::to_string(failed) + " of " + std::to_string(all) + " " + what +
              (failed < all ? "; --keep-going allows that" : ""));
}

}  // namespace anigen
