#pragma once
#include <stdexcept>
#include <string>

namespace anigen {

/// A run that cannot go on although the input was fine (disk full, diverged training). Executables exit 1.
class Error : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Something the user gave us is wrong. Carries where (file, and the place inside it: a JSON pointer, a byte
/// offset, a line) and what to do about it; what() is the one line an executable prints before it exits 2.
class InputError : public Error {
 public:
  /// @param file   path as the user gave it; may be empty when the input is not a file
  /// @param place  JSON pointer, "byte 1234", "line 3"; may be empty
  /// @param problem what is wrong, and what to do when that is not obvious
  InputError(std::string file, std::string place, std::string problem);

  const std::string& file() const { return file_; }
  const std::string& place() const { return place_; }
  const std::string& problem() const { return problem_; }

 private:
  std::string file_, place_, problem_;
};

/// The input is valid but asks for something this build does not do. what() contains "not supported: <feature>".
class NotSupportedError : public InputError {
 public:
  NotSupportedError(std::string file, std::string place, const std::string& feature);
};

/// A file cannot be written: the disk is full, read-only or not ours. It concerns a whole run, not one of its items.
class WriteError : public Error {
 public:
  using Error::Error;
};

/// Ctrl-C, noticed at a safe point after state was saved. Executables exit 130.
class Interrupted : public Error {
 public:
  using Error::Error;
};

/// @throws InputError naming the option unless lowest ≤ value ≤ highest
void require_between(double value, double lowest, double highest, const std::string& option);

/// The exception being handled as the one line that a batch records for the item it came up with, while the others go
/// on: `catch (...) { report.failure = failure_of_item(); }`. An InputError gives what(), std::bad_alloc "out of
/// memory" (and freed memory goes back to the system), any other std::exception its message without LibTorch's
/// backtrace.
/// @throws the exception itself when it concerns the whole run: Interrupted, WriteError, and what is no std::exception
std::string failure_of_item();

}  // namespace anigen
