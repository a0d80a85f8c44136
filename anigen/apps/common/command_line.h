#pragma once
#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace anigen {

/// Options every executable has.
struct CommonOptions {
  std::uint64_t seed = 0;
  bool seed_given = false;     ///< false: a config's own seed holds
  int threads = 0;             ///< 0: all cores
  std::string device = "cpu";  ///< cpu, cuda, cuda:N
  std::string log_level = "info";
  bool quiet = false;
  bool json = false;  ///< print machine-readable JSON on standard output
};

/// Adds --seed --threads --device --log-level --quiet --json --version to an application.
/// @param version_details extra lines of --version (LibTorch, BLAS, device); may be empty
void add_common_options(CLI::App& app, CommonOptions& options, std::function<std::string()> version_details = {});

/// Parses, sets up logging, threads and the interrupt handler, runs body, and turns exceptions into one clear line
/// and an exit status: 0, 2 for bad input, 1 for a failed run, 130 after Ctrl-C.
int run_command(CLI::App& app, CommonOptions& options, int argc, char** argv, const std::function<void()>& body);

}  // namespace anigen
