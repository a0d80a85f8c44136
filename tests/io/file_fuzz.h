#pragma once
#include <filesystem>
#include <functional>
#include <string>

namespace anigen::test {

/// Reads truncated and damaged copies of a file: every prefix of short files (a sample of long ones) and `flips`
/// seeded copies with one to four bytes changed. Expects that reading succeeds or throws anigen::Error, nothing else.
void expect_errors_only(const std::string& bytes, const std::filesystem::path& scratch,
                        const std::function<void(const std::filesystem::path&)>& read, std::size_t flips = 500);

}  // namespace anigen::test
