#pragma once
#include <sys/wait.h>

#include <cstdlib>
#include <string>

/// Tests that hand a file to another program, which need not be installed.
namespace anigen::test {

inline constexpr int kSkipped = 77;  ///< exit code of a test that could not run

/// One word for a shell.
inline std::string quoted(const std::string& text) {
  std::string result = "'";
  for (const char c : text) result += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return result + "'";
}

/// Runs a shell line. @return its exit code, kSkipped when there is no such program, 1 when a signal ended it
inline int run_program(const std::string& line) {
  constexpr int kNotFound = 127;
  const int status = std::system(line.c_str());
  const int code = WIFEXITED(status) ? WEXITSTATUS(status) : 1;
  return code == kNotFound ? kSkipped : code;
}

}  // namespace anigen::test
