#pragma once
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

#include "anigen/core/files.h"

/// Running programs and comparing what they leave, for the tests of whole programs on datasets.
namespace anigen::test {

inline void require(bool ok, const std::string& what) {
  if (!ok) throw std::runtime_error(what);
}

/// @param output where its standard output goes; empty: ours
inline pid_t start_program(const std::vector<std::string>& words, const std::filesystem::path& output = {}) {
  std::vector<char*> arguments;
  for (const std::string& word : words) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  const pid_t child = ::fork();
  require(child >= 0, "cannot fork");
  if (child == 0) {
    if (!output.empty() && std::freopen(output.c_str(), "w", stdout) == nullptr) std::_Exit(127);
    ::execv(arguments[0], arguments.data());
    std::_Exit(127);
  }
  return child;
}

/// Exit status, or minus the signal that ended the process.
inline int wait_for(pid_t child) {
  int status = 0;
  require(::waitpid(child, &status, 0) >= 0, "cannot wait");
  return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
}

inline int run_program(const std::vector<std::string>& words, const std::filesystem::path& output = {}) {
  return wait_for(start_program(words, output));
}

/// Processes that a process started and that still run.
inline std::vector<pid_t> children_of(pid_t process) {
  const std::string id = std::to_string(process);
  std::ifstream file("/proc/" + id + "/task/" + id + "/children");
  std::vector<pid_t> children;
  for (pid_t child; file >> child;) children.push_back(child);
  return children;
}

using Contents = std::map<std::string, std::string>;

/// Every file of a dataset by its path; run/ tells about runs and differs between them.
inline Contents dataset_contents(const std::filesystem::path& folder) {
  Contents files;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    const std::string name = entry.path().lexically_relative(folder).generic_string();
    if (entry.is_regular_file() && name.rfind("run/", 0) != 0) files[name] = read_file(entry.path());
  }
  return files;
}

inline void require_same(const Contents& expected, const Contents& found, const std::string& what) {
  for (const auto& [name, bytes] : expected) {
    const auto other = found.find(name);
    require(other != found.end(), what + ": " + name + " is missing");
    require(other->second == bytes, what + ": " + name + " differs");
  }
  for (const auto& [name, bytes] : found) require(expected.count(name) > 0, what + ": " + name + " is too much");
}

}  // namespace anigen::test
