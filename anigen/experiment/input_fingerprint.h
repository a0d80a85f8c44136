#pragma once
#include <filesystem>
#include <string>

namespace anigen::experiment {

/// What a file, or all files under a folder, are known by: relative path, size and time of change. Cheap enough for
/// folders of many gigabytes; copying a file without its time counts as a change.
/// @throws InputError when there is nothing at that path
std::string input_fingerprint(const std::filesystem::path& path);

/// SHA-256 of a program file; read again only when its size or time has changed. @throws InputError when it is not
/// there
std::string program_fingerprint(const std::filesystem::path& program);

}  // namespace anigen::experiment
