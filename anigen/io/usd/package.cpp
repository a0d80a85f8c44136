#include "anigen/io/usd/package.h"

#include <zlib.h>
#include <cstdint>
#include <limits>

#include "anigen/core/error.h"

namespace anigen::io::usd_export {

namespace {

constexpr std::uint32_t kLocalHeader = 0x04034b50, kDirectoryEntry = 0x02014b50, kDirectoryEnd = 0x06054b50;
constexpr std::size_t kLocalHeaderSize = 30, kExtraHeaderSize = 4;
constexpr std::uint16_t kPadding = 0x1986;  // id of the extra field that only fills up
constexpr std::uint16_t kZipVersion = 10, kStored = 0, kFirstDay = 0x21;

void append_u16(std::size_t value, std::string& out) {
  out += static_cast<char>(value & 0xFF);
  out += static_cast<char>(value >> 8 & 0xFF);
}

void append_u32(std::size_t value, std::string& out) {
  append_u16(value & 0xFFFF, out);
  append_u16(value >> 16 & 0xFFFF, out);
}

/// Length of the extra field that puts the data after it at a multiple of kPackageAlignment.
std::size_t extra_length(std::size_t offset) {
  std::size_t length = (kPackageAlignment - offset % kPackageAlignment) % kPackageAlignment;
  if (length > 0 && length < kExtraHeaderSize) length += kPackageAlignment;
  return length;
}

/// The fields that a local header and its entry in the directory share.
void append_common(const PackageFile& file, std::size_t crc, std::size_t extra, std::string& out) {
  append_u16(kZipVersion, out);
  append_u16(0, out);  // flags
  append_u16(kStored, out);
  append_u16(0, out);  // time
  append_u16(kFirstDay, out);
  append_u32(crc, out);
  append_u32(file.bytes.size(), out);
  append_u32(file.bytes.size(), out);
  append_u16(file.name.size(), out);
  append_u16(extra, out);
}

}  // namespace

std::string package_bytes(const std::vector<PackageFile>& files, const std::string& package) {
  constexpr std::size_t kMostBytes = std::numeric_limits<std::uint32_t>::max();
  constexpr std::size_t kMostFiles = std::numeric_limits<std::uint16_t>::max();
  std::size_t total = 0;
  for (const PackageFile& file : files)
    total += file.bytes.size() + 2 * file.name.size() + 4 * kPackageAlignment;  // more than its headers take
  if (total > kMostBytes || files.size() > kMostFiles)
    throw NotSupportedError(package, "", "a package of more than 4 GiB or 65,535 files");
  std::string out, directory;
  for (const PackageFile& file : files) {
    const std::size_t crc =
        ::crc32(0, reinterpret_cast<const Bytef*>(file.bytes.data()), static_cast<uInt>(file.bytes.size()));
    const std::size_t start = out.size();
    const std::size_t extra = extra_length(start + kLocalHeaderSize + file.name.size());
    append_u32(kLocalHeader, out);
    append_common(file, crc, extra, out);
    out += file.name;
    if (extra > 0) {
      append_u16(kPadding, out);
      append_u16(extra - kExtraHeaderSize, out);
      out.append(extra - kExtraHeaderSize, '\0');
    }
    out += file.bytes;
    append_u32(kDirectoryEntry, directory);
    append_u16(kZipVersion, directory);
    append_common(file, crc, 0, directory);
    append_u16(0, directory);  // comment
    append_u16(0, directory);  // disk
    append_u16(0, directory);  // internal attributes
    append_u32(0, directory);  // external attributes
    append_u32(start, directory);
    directory += file.name;
  }
  const std::size_t start = out.size();
  out += directory;
  append_u32(kDirectoryEnd, out);
  append_u16(0, out);
  append_u16(0, out);
  append_u16(files.size(), out);
  append_u16(files.size(), out);
  append_u32(directory.size(), out);
  append_u32(start, out);
  append_u16(0, out);
  return out;
}

}  // namespace anigen::io::usd_export
