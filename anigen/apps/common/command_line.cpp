#include "anigen/apps/common/command_line.h"

#include <cstdio>
#include <exception>
#include <new>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/kernel_form.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/process.h"
#include "anigen/core/version.h"

namespace anigen {

void add_common_options(CLI::App& app, CommonOptions& options, std::function<std::string()> version_details,
                        const std::vector<UnusedOption>& unused) {
  app.add_option("--seed", options.seed, "Seed of every random draw")
      ->check(whole_number(0))
      ->each([&options](const std::string&) { options.seed_given = true; });
  app.add_option("--threads", options.threads, "Threads to use; 0 means all cores")->check(whole_number(0, 4096));
  app.add_option("--device", options.device, "cpu, cuda or cuda:N")->capture_default_str()->check(device_name());
  app.add_option("--log-level", options.log_level, "debug, info, warn, error or off")
      ->capture_default_str()
      ->check(CLI::IsMember({"debug", "info", "warn", "error", "off"}));
  app.add_flag("--quiet", options.quiet, "No progress bars, warnings only");
  app.add_flag("--json", options.json, "Print results as JSON on standard output");
  options.unused = unused;
  for (const UnusedOption& option : unused) {
    CLI::Option* declared = app.get_option(option.name);
    const bool is_flag = declared->get_expected_min() == 0;
    app.remove_option(declared);
    // Known, but with neither a line in --help nor a check: run_command() refuses it with the reason.
    CLI::Option* hidden = is_flag ? app.add_flag(option.name)
                                  : app.add_option_function<std::string>(option.name, [](const std::string&) {});
    hidden->group("");
  }
  app.set_version_flag("--version", [details = std::move(version_details)] {
    std::string text = "anigen " + named_version();
    text += "\n" + kernel_form_details();
    if (details) text += "\n" + details();
    return text;
  });
}

void refuse_given(const CLI::App& app, const std::vector<std::string>& names, const std::string& reason) {
  for (const std::string& name : names) {
    if (app.get_option(name)->count() > 0) throw InputError("", name, reason);
  }
}

int run_command(CLI::App& app, CommonOptions& options, int argc, char** argv, const std::function<void()>& body) {
  try {
    kernel_form();  // refuses what ANIGEN_KERNELS says before anything else
    app.parse(argc, argv);
  } catch (const InputError& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 2;
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  try {
    for (const UnusedOption& option : options.unused) refuse_given(app, {option.name}, "this program " + option.reason);
    log::setup(options.quiet && options.log_level == "info" ? "warn" : options.log_level);
    Progress::set_quiet(options.quiet);
    set_thread_count(options.threads);
    install_interrupt_handler();
    body();
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

}  // namespace anigen
