// The bytes of a package against the formats ZIP and USDZ.
#include "anigen/io/usd/package.h"

#include <gtest/gtest.h>
#include <zlib.h>

#include <cstdint>
#include <cstring>

namespace anigen::io::usd_export {
namespace {

std::size_t field(const std::string& bytes, std::size_t offset, std::size_t width) {
  std::uint32_t value = 0;
  std::memcpy(&value, bytes.data() + offset, width);
  return value;
}

TEST(UsdPackage, HoldsItsFilesUncompressedAndAligned) {
  std::vector<PackageFile> files{{"scene.usda", "#usda 1.0\n"}, {"textures/a.png", std::string(1000, 'x')}, {"b", ""}};
  for (std::size_t n = 0; n < 70; ++n) files.push_back({"n" + std::string(n, 'n'), std::string(n, 'y')});
  const std::string package = package_bytes(files, "x.usdz");
  const std::size_t end = package.size() - 22;
  ASSERT_EQ(field(package, end, 4), 0x06054b50u);
  EXPECT_EQ(field(package, end + 8, 2), files.size());
  EXPECT_EQ(field(package, end + 10, 2), files.size());
  std::size_t entry = field(package, end + 16, 4), local = 0;
  EXPECT_EQ(entry + field(package, end + 12, 4), end);
  for (const PackageFile& file : files) {
    ASSERT_EQ(field(package, entry, 4), 0x02014b50u);
    EXPECT_EQ(field(package, entry + 42, 4), local);
    EXPECT_EQ(package.substr(entry + 46, file.name.size()), file.name);
    ASSERT_EQ(field(package, local, 4), 0x04034b50u);
    const auto crc =
        ::crc32(0, reinterpret_cast<const Bytef*>(file.bytes.data()), static_cast<uInt>(file.bytes.size()));
    const std::pair<std::size_t, std::size_t> headers[] = {{local, 0}, {entry, 2}};  // the directory's are 2 later
    for (const auto& [header, later] : headers) {
      EXPECT_EQ(field(package, header + later + 6, 2), 0u) << "flags";
      EXPECT_EQ(field(package, header + later + 8, 2), 0u) << "method";
      EXPECT_EQ(field(package, header + later + 14, 4), crc);
      EXPECT_EQ(field(package, header + later + 18, 4), file.bytes.size());
      EXPECT_EQ(field(package, header + later + 22, 4), file.bytes.size());
      EXPECT_EQ(field(package, header + later + 26, 2), file.name.size());
    }
    const std::size_t extra = field(package, local + 28, 2), data = local + 30 + file.name.size() + extra;
    EXPECT_EQ(data % kPackageAlignment, 0u) << file.name;
    if (extra > 0) {
      EXPECT_EQ(field(package, local + 30 + file.name.size() + 2, 2), extra - 4) << "length of the padding";
    }
    EXPECT_EQ(package.substr(data, file.bytes.size()), file.bytes);
    local = data + file.bytes.size();
    entry += 46 + file.name.size();
  }
}

}  // namespace
}  // namespace anigen::io::usd_export
