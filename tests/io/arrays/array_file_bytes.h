#pragma once
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/random.h"
#include "tests/support/paths.h"

namespace anigen::test {

/// Bytes of a C string literal that may hold zeros: raw("\x80\x02\0").
template <std::size_t N>
std::string raw(const char (&literal)[N]) {
  return std::string(literal, N - 1);
}

/// Little-endian integer of `size` bytes.
inline std::string little(std::uint64_t value, int size) {
  std::string bytes;
  for (int i = 0; i < size; ++i) bytes += static_cast<char>(value >> (8 * i) & 0xFF);
  return bytes;
}

/// NPY version 1 file from its header's dict and its data.
inline std::string npy(std::string header, const std::string& data) {
  header += '\n';
  return raw("\x93NUMPY\x01\0") + little(header.size(), 2) + header + data;
}

/// A zip archive of stored members, built by hand: what torch.save and numpy.savez write, without our writer.
inline std::string stored_zip(const std::vector<std::pair<std::string, std::string>>& members) {
  std::string files, directory;
  for (const auto& [name, content] : members) {
    std::uint32_t crc = 0xFFFFFFFFu;
    for (const char c : content) {
      crc ^= static_cast<unsigned char>(c);
      for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ (crc & 1u ? 0xEDB88320u : 0u);
    }
    const std::string sizes =
        little(content.size(), 4) + little(content.size(), 4) + little(name.size(), 2) + little(0, 2);
    const std::string common = little(20, 2) + little(0, 4) + little(0, 4) + little(~crc & 0xFFFFFFFFu, 4) + sizes;
    directory += "PK\x01\x02" + little(20, 2) + common + little(0, 8) + little(0, 2) + little(files.size(), 4) + name;
    files += "PK\x03\x04" + common + name + content;
  }
  const std::string count = little(members.size(), 2);
  return files + directory + "PK\x05\x06" + little(0, 4) + count + count + little(directory.size(), 4) +
         little(files.size(), 4) + little(0, 2);
}

/// Writes without waiting for the disk, for tests that write hundreds of files.
inline void write_quickly(const std::filesystem::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary | std::ios::trunc) << bytes;
}

/// Writes pickle instructions by name, so that tests say what a pickle does. Protocol 2 unless said otherwise.
class PickleBuilder {
 public:
  explicit PickleBuilder(int protocol = 2) { bytes_ = "\x80" + little(static_cast<std::uint64_t>(protocol), 1); }
  PickleBuilder& op(const std::string& instruction) {
    bytes_ += instruction;
    return *this;
  }
  PickleBuilder& mark() { return op("("); }
  PickleBuilder& none() { return op("N"); }
  PickleBuilder& boolean(bool value) { return op(value ? "\x88" : "\x89"); }
  PickleBuilder& integer(std::int32_t value) { return op("J" + little(static_cast<std::uint32_t>(value), 4)); }
  PickleBuilder& text(const std::string& value) { return op("X" + little(value.size(), 4) + value); }
  PickleBuilder& data(const std::string& value) { return op("B" + little(value.size(), 4) + value); }
  PickleBuilder& real(double value) {
    std::uint64_t bits;
    std::memcpy(&bits, &value, sizeof bits);
    std::string big = little(bits, 8);
    return op("G" + std::string(big.rbegin(), big.rend()));
  }
  PickleBuilder& global(const std::string& module, const std::string& name) {
    return op("c" + module + "\n" + name + "\n");
  }
  PickleBuilder& tuple() { return op("t"); }  ///< of everything since the mark
  PickleBuilder& reduce() { return op("R"); }
  PickleBuilder& build() { return op("b"); }
  /// numpy.dtype with its byte order set, as numpy pickles it.
  PickleBuilder& dtype(const std::string& code, const std::string& order = "<") {
    global("numpy", "dtype").mark().text(code).boolean(false).boolean(true).tuple().reduce();
    return mark().integer(3).text(order).none().none().none().integer(-1).integer(-1).integer(0).tuple().build();
  }
  /// A numpy array, ready for its state: mark, 1, shape; then add dtype, order, content and call end_array().
  PickleBuilder& begin_array(const std::vector<int>& shape) {
    global("numpy.core.multiarray", "_reconstruct").mark().global("numpy", "ndarray");
    mark().integer(0).tuple().data("b").tuple().reduce();
    mark().integer(1).mark();
    for (const int size : shape) integer(size);
    return tuple();
  }
  PickleBuilder& end_array() { return tuple().build(); }
  std::string stop() const { return bytes_ + "."; }

 private:
  std::string bytes_;
};

/// Feeds `read` the file cut at many lengths and with seeded damage: it may refuse with an anigen::Error or accept,
/// anything else fails the test. @return how many variants were refused
inline int read_damaged(const std::string& bytes, const std::string& file_name,
                        const std::function<void(const std::filesystem::path&)>& read, int mutations = 200) {
  const TemporaryFolder folder;
  const std::filesystem::path path = folder / file_name;
  int refused = 0;
  const auto attempt = [&](const std::string& variant, const std::string& what) {
    write_quickly(path, variant);
    try {
      read(path);
    } catch (const Error& error) {
      ++refused;
      EXPECT_NE(std::string(error.what()), "") << what;
    } catch (const std::exception& error) {
      ADD_FAILURE() << what << " gave a foreign exception: " << error.what();
    }
  };
  const std::size_t step = std::max<std::size_t>(1, bytes.size() / 100);
  for (std::size_t length = 0; length < bytes.size(); length += step)
    attempt(bytes.substr(0, length), "cut at " + std::to_string(length));
  Rng rng(7, "damaged files");
  for (int i = 0; i < mutations; ++i) {
    std::string variant = bytes;
    const std::size_t flips = 1 + rng.index(4);
    for (std::size_t k = 0; k < flips; ++k) variant[rng.index(variant.size())] = static_cast<char>(rng.index(256));
    attempt(variant, "mutation " + std::to_string(i));
  }
  return refused;
}

}  // namespace anigen::test
