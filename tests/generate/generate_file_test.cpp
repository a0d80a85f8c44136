#include <gtest/gtest.h>

#include <filesystem>
#include <iterator>
#include <string>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/generate/generate_assets.h"
#include "anigen/io/gltf/gltf.h"
#include "tests/generate/generate_assets_case.h"

namespace anigen::generate {
namespace {

namespace fs = std::filesystem;

using GenerateFile = GenerateAssets;

TEST_F(GenerateFile, OneFileForOneImage) {
  GenerateRequest request = request_;
  fs::create_directories(folder_ / "files");
  request.output = folder_ / "files/disc.glb";
  const GenerationReport report = generate_file(request, {picture_});
  ASSERT_EQ(report.failure, "");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_ / "files"), fs::directory_iterator()), 1);
  const Asset asset = io::read_gltf(request.output).asset;
  EXPECT_EQ(report.details["joints"], asset.skeleton.size());
  EXPECT_EQ(asset.animations.size(), 1u);
  EXPECT_NE(to_text({report}).find(request.output.string() + ", "), std::string::npos) << to_text({report});
  EXPECT_EQ(to_json({report})[0]["file"], request.output.string());

  // A failure leaves what is there.
  const std::string before = read_file(request.output);
  write_file_atomically(folder_ / "broken.png", "no picture");
  EXPECT_NE(generate_file(request, {folder_ / "broken.png"}).failure, "");
  EXPECT_EQ(read_file(request.output), before);
  request.obj = true;
  EXPECT_THROW(generate_file(request, {picture_}), InputError);
  request.obj = false;
  request.output = folder_ / "files/disc.obj";
  EXPECT_THROW(generate_file(request, {picture_}), InputError);
}

}  // namespace
}  // namespace anigen::generate
