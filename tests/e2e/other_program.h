#pragma once
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <exception>
#include <functional>
#include <stdexcept>
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

inline void require(bool ok, const std::string& what) {
  if (!ok) throw std::runtime_error(what);
}

/// Starts a shell line beside this process. @param prepare is called in the new process before it
inline pid_t start_program(const std::string& line, const std::function<void()>& prepare = {}) {
  const pid_t child = ::fork();
  require(child >= 0, "cannot fork");
  if (child != 0) return child;
  try {
    if (prepare) prepare();
    ::execl("/bin/sh", "sh", "-c", ("exec " + line).c_str(), static_cast<char*>(nullptr));
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
  }
  std::_Exit(127);
}

}  // namespace anigen::test
