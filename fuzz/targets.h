#pragma once
#include <map>
#include <string>

namespace anigen::fuzz {

/// Reads bytes that may be damaged or hostile. It may throw anigen::Error and nothing else; what it accepts must be
/// sound, or it ends the process by require().
using Target = void (*)(const std::string& bytes);

/// By name: readers of files (readers.cpp), and what reads requests and experiments (programs.cpp).
std::map<std::string, Target> targets();

/// The targets of programs.cpp, for builds with the studio.
std::map<std::string, Target> program_targets();

/// Calls a target. An Error is a good answer: the input was refused with a reason, which $ANIGEN_FUZZ_SAYS prints.
void run(Target target, const std::string& bytes);

/// Ends the process with the sentence when it does not hold.
void require(bool holds, const char* sentence);

/// Writes the bytes to a temporary file, whose name stays the same in this process and which goes with it.
std::string as_file(const std::string& bytes, const std::string& extension);

}  // namespace anigen::fuzz
