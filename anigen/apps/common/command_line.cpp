#include "anigen/apps/common/command_line.h"

#include <cstdio>
#include <exception>
#include <new>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/interrupt.h"
#include "anigen/core/kernel_form.h"
#include "anigen/core/log.h"
#include "anigen/core/parallel.h"
#include "anigen/core/progress.h"
#include "anigen/core/version.h"

namespace anigen {

void add_common_options(CLI::App& app, CommonOptions& options, std::function<std::string()> version_details) {
  app.add_option("--seed", options.seed, "Seed of every random draw")->each([&options](const std::string&) {
    options.seed_given = true;
  });
  app.add_option("--threads", options.threads, "Threads to use; 0 means all cores")->check(CLI::NonNegativeNumber);
  app.add_option("--device", options.device, "cpu, cuda or cuda:N")->capture_default_str();
  app.add_option("--log-level", options.log_level, "debug, info, warn, error or off")->capture_default_str();
  app.add_flag("--quiet", options.quiet, "No progress bars, warnings only");
  app.add_flag("--json", options.json, "Print results as JSON on standard output");
  app.set_version_flag("--version", [details = std::move(version_details)] {
    std::string text = std::string("anigen ") + kVersion;
    text += "\n" + kernel_form_details();
    if (details) text += "\n" + details();
    return text;
  });
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
