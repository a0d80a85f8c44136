#pragma once
#include <spdlog/spdlog.h>
#include <chrono>
#include <cstddef>
#include <filesystem>
#include <mutex>
#include <string>

namespace anigen::log {

using spdlog::debug;
using spdlog::error;
using spdlog::info;
using spdlog::warn;

/// Sends log lines to standard error, one plain line each. @param level debug, info, warn, error or off
/// @throws InputError on another word
void setup(const std::string& level);

/// Also appends every line, with its time, to this file (the run folder's log.txt).
void also_to_file(const std::filesystem::path& file);

/// Says a warning once per process however often the place is passed.
void warn_once(const std::string& message);

}  // namespace anigen::log

namespace anigen {

/// Progress of long work on standard error: a bar with rate and time left on a terminal, otherwise a plain line
/// at most every ten seconds. Thread-safe. Silent when quiet was set.
class Progress {
 public:
  Progress(std::string label, std::size_t total, std::string unit = "items");
  ~Progress() { finish(); }

  void advance(std::size_t steps = 1);
  /// A word shown after the bar, for example the current loss.
  void note(std::string text);
  /// Starts the count elsewhere, when work resumes.
  void start_at(std::size_t done);
  void finish();

  static void set_quiet(bool quiet);

 private:
  void draw(bool last);

  std::mutex mutex_;
  std::string label_, unit_, note_;
  std::size_t total_, done_ = 0, first_ = 0;
  std::chrono::steady_clock::time_point started_, drawn_;
  bool finished_ = false;
};

/// Asks the C library to keep what this process frees. Programs that free and ask for the same arrays over and over
/// call it first: otherwise the larger ones go back to the kernel each time, and clearing their pages again takes a
/// tenth of a training step of small models, or of a Gromov–Wasserstein distance. Does nothing without glibc.
void keep_freed_memory();

/// Gives what this process has freed back to the system, for others to use. Does nothing without glibc.
void release_freed_memory();

}  // namespace anigen
