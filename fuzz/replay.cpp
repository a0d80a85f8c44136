// Gives every file of a corpus to its target, once, without libFuzzer: what was found and mended stays mended.
//   fuzz_replay FOLDER     with a folder per target, as fuzz/corpus.tar.xz has them
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "fuzz/targets.h"

namespace {

namespace fs = std::filesystem;

constexpr double kMostSeconds = 10.0;  // of one file
constexpr unsigned kPatience = 60;

char current[512] = "";

/// Says which file it was, and lets the process end as it would have.
void tell(int signal) {
  const char* words = signal == SIGALRM ? "fuzz_replay: hangs: " : "fuzz_replay: ended by a signal: ";
  (void)!::write(STDERR_FILENO, words, std::strlen(words));
  (void)!::write(STDERR_FILENO, current, std::strlen(current));
  (void)!::write(STDERR_FILENO, "\n", 1);
  std::signal(signal, SIG_DFL);
  ::raise(signal);
}

std::vector<fs::path> sorted_entries(const fs::path& folder) {
  std::vector<fs::path> entries;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) entries.push_back(entry.path());
  std::sort(entries.begin(), entries.end());
  return entries;
}

int replay(const fs::path& folder) {
  const auto targets = anigen::fuzz::targets();
  std::size_t files = 0;
  int slow = 0;
  std::printf("%-12s %6s %10s %12s\n", "target", "files", "seconds", "slowest, ms");
  for (const fs::path& place : sorted_entries(folder)) {
    const auto target = targets.find(place.filename());
    if (target == targets.end()) throw anigen::InputError(place.string(), "", "is no target of fuzz/");
    double sum = 0.0, most = 0.0;
    const std::vector<fs::path> inputs = sorted_entries(place);
    for (const fs::path& input : inputs) {
      std::snprintf(current, sizeof current, "%s", input.c_str());
      ::alarm(kPatience);
      const std::string bytes = anigen::read_file(input);
      const auto began = std::chrono::steady_clock::now();
      anigen::fuzz::run(target->second, bytes);
      const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
      sum += seconds;
      most = std::max(most, seconds);
      if (seconds <= kMostSeconds) continue;
      std::fprintf(stderr, "fuzz_replay: %s takes %.1f s\n", current, seconds);
      ++slow;
    }
    std::printf("%-12s %6zu %10.2f %12.1f\n", place.filename().c_str(), inputs.size(), sum, 1e3 * most);
    files += inputs.size();
  }
  if (files == 0) throw anigen::InputError(folder.string(), "", "holds no files");
  return slow > 0 ? 1 : 0;
}

}  // namespace

int main(int count, char** words) {
  if (count != 2) {
    std::fprintf(stderr, "usage: fuzz_replay FOLDER\n");
    return 2;
  }
  // Targets write thousands of small files, and sync some: to memory.
  if (::access("/dev/shm", W_OK) == 0) ::setenv("TMPDIR", "/dev/shm", /*overwrite=*/0);
  for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT, SIGALRM}) std::signal(signal, tell);
  try {
    return replay(words[1]);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "error: %s\n", error.what());
    return 1;
  }
}
