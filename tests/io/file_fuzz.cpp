#include "tests/io/file_fuzz.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <exception>
#include <fstream>

#include "anigen/core/error.h"
#include "anigen/core/random.h"

namespace anigen::test {
namespace {

void expect_error_or_success(const std::string& bytes, const std::filesystem::path& scratch,
                             const std::function<void(const std::filesystem::path&)>& read, const std::string& what) {
  std::ofstream(scratch, std::ios::binary | std::ios::trunc)
      .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  try {
    read(scratch);
  } catch (const Error& error) {
    EXPECT_STRNE(error.what(), "") << what;
  } catch (const std::exception& error) {
    ADD_FAILURE() << what << " raised something else: " << error.what();
  }
}

}  // namespace

void expect_errors_only(const std::string& bytes, const std::filesystem::path& scratch,
                        const std::function<void(const std::filesystem::path&)>& read, std::size_t flips) {
  const std::size_t step = std::max<std::size_t>(1, bytes.size() / 200);
  for (std::size_t length = 0; length < bytes.size(); length += step)
    expect_error_or_success(bytes.substr(0, length), scratch, read, "the first " + std::to_string(length) + " bytes");
  for (std::size_t i = 0; i < flips; ++i) {
    Rng rng(7, "file_fuzz", i);
    std::string damaged = bytes;
    for (std::size_t n = 1 + rng.index(4); n > 0; --n)
      damaged[rng.index(bytes.size())] = static_cast<char>(rng.index(256));
    expect_error_or_success(damaged, scratch, read, "damaged copy " + std::to_string(i));
  }
}

}  // namespace anigen::test
