#pragma once
#include <filesystem>
#include <string>

namespace anigen::experiment {

/// What a file, or all files under a folder, are known by: relative path, size and time of change. Cheap enough for
/// folders of many gigabytes; copying a file without its time counts as a change.
/// @throws InputError when there is nothing at that path
std::string input_fingerprint(const std::filesystem::path& path);

/// SHA-256 of a program file but for the commit that it was built of (core/version.h) and the linker's own digest of
/// it: a commit that leaves a program's code as it was leaves this as it was. Read again only when the file's size or
/// time has changed. @throws InputError when it is not there
std::string program_fingerprint(const std::filesystem::path& program);

}  // namespace anigen::experiment
