#pragma once
#include <functional>
#include <string>

#include "anigen/core/process.h"

namespace anigen {

/// Runs a reader of a foreign file in a process of its own (run_guarded). What it refuses arrives as it threw it:
/// InputError and NotSupportedError with their place and problem; any other Error, and memory that ran out, as an
/// InputError.
/// @param file   name in messages
/// @param crashed problem of a reader that crashed or ran past a limit: "Assimp cannot read it: it %; export it again",
///               where % stands for how it ended
/// @return what the reader returned; check it like a foreign file, for a hostile file may have taken its reader over
/// @throws InputError, NotSupportedError; Error when the system refuses a process
std::string read_guarded(const std::string& file, const std::string& crashed, const ProcessLimits& limits,
                         const std::function<std::string()>& reader);

}  // namespace anigen
