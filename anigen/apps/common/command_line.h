#pragma once
#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace anigen {

/// One of the common options that a program would not look at.
struct UnusedOption {
  std::string name, reason;  ///< the reason completes "this program …"
};

/// Options every executable has.
struct CommonOptions {
  std::uint64_t seed = 0;
  bool seed_given = false;     ///< false: a config's own seed holds
  int threads = 0;             ///< 0: all cores
  std::string device = "cpu";  ///< cpu, cuda, cuda:N
  std::string log_level = "info";
  bool quiet = false;
  bool json = false;                 ///< print machine-readable JSON on standard output
  std::vector<UnusedOption> unused;  ///< of these, as add_common_options() was told
};

/// Adds --seed --threads --device --log-level --quiet --json --version to an application.
/// @param version_details extra lines of --version (LibTorch, BLAS, device); may be empty
/// @param unused is left out of --help, and refused with its reason when it is given
void add_common_options(CLI::App& app, CommonOptions& options, std::function<std::string()> version_details = {},
                        const std::vector<UnusedOption>& unused = {});

/// Refuses options that the rest of a command line leaves without effect.
/// @param reason why, and what to do @throws InputError naming the first of them that was given
void refuse_given(const CLI::App& app, const std::vector<std::string>& names, const std::string& reason);

/// Parses, sets up logging, threads and the interrupt handler, runs body, and turns exceptions into one clear line
/// and an exit status: 0, 2 for bad input, 1 for a failed run, 130 after Ctrl-C.
int run_command(CLI::App& app, CommonOptions& options, int argc, char** argv, const std::function<void()>& body);

}  // namespace anigen
