#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace anigen {

/// SHA-256 (FIPS 180-4) of bytes that may arrive in pieces. Names dataset entries by their content.
class Sha256 {
 public:
  Sha256();
  void update(std::string_view bytes);
  /// The digest in 64 lower-case hexadecimal digits. The object is used up afterwards.
  std::string finish();

 private:
  void compress(const unsigned char* block);

  std::array<std::uint32_t, 8> state_;
  std::array<unsigned char, 64> block_{};
  std::size_t filled_ = 0;
  std::uint64_t total_bytes_ = 0;
};

/// Digest of one piece.
std::string sha256(std::string_view bytes);
/// Digest of a file of any size, which is read in pieces. @throws InputError when it cannot be read
std::string sha256_of_file(const std::filesystem::path& file);

/// RFC 4648 with padding, for buffers inside JSON and pictures inside HTML.
std::string base64(std::string_view bytes);
std::string base64(const std::vector<std::uint8_t>& bytes);

}  // namespace anigen
