#pragma once
#include <spdlog/spdlog.h>

#include <filesystem>
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
