#include "anigen/io/write_rigged.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "tests/io/small_asset.h"
#include "tests/support/paths.h"

namespace anigen::io {
namespace {

TEST(WriteRigged, TheExtensionChoosesTheFormat) {
  const test::TemporaryFolder folder;
  const Asset asset = test::small_asset();
  const auto begins = [&](const std::string& name, const std::string& bytes) {
    EXPECT_TRUE(is_rigged_output(name));
    write_rigged(folder / name, asset);
    EXPECT_EQ(read_file(folder / name).substr(0, bytes.size()), bytes) << name;
  };
  begins("a.glb", "glTF");
  begins("a.gltf", "{");
  begins("a.FBX", "Kaydara FBX Binary");
  begins("a.usda", "#usda 1.0");
  begins("a.usdz", "PK\3\4");
}

TEST(WriteRigged, OtherExtensionsAreRefused) {
  const test::TemporaryFolder folder;
  for (const char* const name : {"a.obj", "a.usd", "a", "a.fbx.zip"}) {
    EXPECT_FALSE(is_rigged_output(name));
    EXPECT_THROW(write_rigged(folder / name, test::small_asset()), InputError) << name;
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  for (const std::string& word : rigged_format_words()) EXPECT_TRUE(is_rigged_output("a." + word));
}

}  // namespace
}  // namespace anigen::io
