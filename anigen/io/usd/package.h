#pragma once
#include <cstddef>
#include <string>
#include <vector>

namespace anigen::io::usd_export {

struct PackageFile {
  std::string name;  ///< ASCII, with '/' between folders
  std::string bytes;
};

/// Every file in a package starts at a multiple of this, so that a reader can map it into memory.
inline constexpr std::size_t kPackageAlignment = 64;

/// A USDZ package: a ZIP archive without compression. The first file is the one that a reader opens. Times are that of
/// the format's first day, so that the same files give the same bytes.
/// @param package for messages @throws NotSupportedError for more than 4 GiB or 65,535 files, which need ZIP64
std::string package_bytes(const std::vector<PackageFile>& files, const std::string& package);

}  // namespace anigen::io::usd_export
