#pragma once
#include <filesystem>
#include <string>

namespace anigen {

/// File of a module of this project, a shared object that is loaded when something needs it. It lies in lib/anigen
/// beside the folder of the program or of the library that this code is in, or one folder further up; in `anigen`
/// beside that library; or in either's own folder.
/// @param name "anigen-torch.so" @return where it would lie when it is nowhere
std::filesystem::path find_module(const std::string& name);

/// Loads it, or finds it loaded already. It finds the functions that the program or libanigen.so has as well there, so
/// that logging, progress and signals are one.
/// @return handle for dlsym, never null @throws Error naming the file when it cannot be loaded
void* load_module(const std::filesystem::path& file);

}  // namespace anigen
