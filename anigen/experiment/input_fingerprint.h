#pragma once
#include <filesystem>
#include <string>

namespace anigen::experiment {

/// What a file, or all files under a folder, are known by: relative path, size and time of change. Cheap enough for
/// folders of many gigabytes; copying a file without its time counts as a change.
/// @throws InputError when there is nothing at that path
std::string input_fingerprint(const std::filesystem::path& path);

/// SHA-256 of a program file and of the module that it loads, ../lib/anigen/anigen-torch.so, where there is one
/// (apps/common/torch_half.h); but for the commit that they were built of (core/version.h) and the linker's own digest
/// of them: a commit that leaves the code as it was leaves this as it was. Read again only when a file's size or time
/// has changed. @throws InputError when the program is not there
std::string program_fingerprint(const std::filesystem::path& program);

}  // namespace anigen::experiment
