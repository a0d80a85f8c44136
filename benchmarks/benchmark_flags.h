#pragma once
#include <cstdio>
#include <cstdlib>
#include <optional>
#include <string>

#include "anigen/core/openblas.h"

namespace anigen {

/// Flags of Google Benchmark that benchmarks with a main() of their own understand.
struct BenchmarkFlags {
  std::string out;     ///< --benchmark_out=FILE
  std::string filter;  ///< --benchmark_filter=WORD: only tasks whose name contains WORD, beside what they are shares of
  int repetitions = 0;  ///< --benchmark_repetitions=N: rounds; 0: as many as the benchmark is made for

  int rounds(int usual) const { return repetitions > 0 ? repetitions : usual; }
};

/// Other --benchmark_* flags are accepted and ignored, so that one script can run all benchmarks.
/// Starts the benchmark once more where OpenBLAS chose slow kernels, as programs do. @return nothing, after a line on
/// standard error, when there is an argument that is none of these
inline std::optional<BenchmarkFlags> benchmark_flags(int argc, char** argv) {
  start_with_openblas_core(argv);
  BenchmarkFlags flags;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    const auto value = [&](const std::string& flag) -> std::optional<std::string> {
      if (word.compare(0, flag.size(), flag) != 0) return std::nullopt;
      return word.substr(flag.size());
    };
    if (const auto file = value("--benchmark_out=")) {
      flags.out = *file;
    } else if (const auto part = value("--benchmark_filter=")) {
      flags.filter = *part;
    } else if (const auto count = value("--benchmark_repetitions=")) {
      flags.repetitions = std::atoi(count->c_str());
    } else if (word.compare(0, 12, "--benchmark_") != 0) {
      std::fprintf(stderr, "usage: %s [--benchmark_filter=WORD] [--benchmark_repetitions=N] [--benchmark_out=FILE]\n",
                   argv[0]);
      return std::nullopt;
    }
  }
  return flags;
}

}  // namespace anigen
