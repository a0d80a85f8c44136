#pragma once
#include <cstdio>
#include <optional>
#include <string>

namespace anigen {

/// For benchmarks with a main() of their own: the FILE of --benchmark_out=FILE, or "". Other --benchmark_* flags are
/// accepted and ignored, so that one script can run all benchmarks.
/// @return nothing, after a line on standard error, when there is an argument that is none of these
inline std::optional<std::string> benchmark_out(int argc, char** argv) {
  const std::string flag = "--benchmark_out=";
  std::string out;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i];
    if (word.compare(0, flag.size(), flag) == 0) {
      out = word.substr(flag.size());
    } else if (word.compare(0, 12, "--benchmark_") != 0) {
      std::fprintf(stderr, "usage: %s [--benchmark_out=FILE]\n", argv[0]);
      return std::nullopt;
    }
  }
  return out;
}

}  // namespace anigen
