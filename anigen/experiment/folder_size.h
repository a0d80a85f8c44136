#pragma once
#include <cstdint>
#include <filesystem>

namespace anigen::experiment {

/// Bytes of the files under a folder; what vanishes meanwhile, or cannot be read, counts nothing.
std::uint64_t folder_size(const std::filesystem::path& folder);

}  // namespace anigen::experiment
