#pragma once
#include <chrono>
#include <cstddef>
#include <mutex>
#include <string>

namespace anigen {

/// Progress of long work on standard error: a bar with rate and time left on a terminal, otherwise a plain line
/// at most every ten seconds. Thread-safe. Silent when quiet was set.
class Progress {
 public:
  Progress(std::string label, std::size_t total, std::string unit = "items");
  ~Progress();

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

}  // namespace anigen
