#include <gtest/gtest.h>

#include <filesystem>

#include "anigen/io/gltf.h"
#include "tests/rig/binding_shapes.h"
#include "tests/support/paths.h"

namespace anigen::rig {
namespace {

using namespace anigen::test;

/// Files of people: parts that overlap and float, seams, joints that nothing hangs on, hundreds of them.
TEST(BindingAssets, EveryRealMeshGetsSoundRowsFromEveryBinding) {
  const std::filesystem::path folder = test::assets_dir() / "rigged";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << folder << " does not exist";
  std::size_t bodies = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    const std::filesystem::path& file = entry.path();
    if (file.extension() != ".glb" && file.extension() != ".gltf") continue;
    if (file.parent_path().filename() == "negative") continue;
    SCOPED_TRACE(file.string());
    const Asset asset = io::read_gltf(file).asset;
    const Body body{asset.mesh, asset.skeleton};
    for (const SkinBinding binding : kAllBindings) {
      const SkinWeights skin = bound(binding, body, coarse(48));
      ASSERT_NO_FATAL_FAILURE(expect_sound(skin, body));
    }
    ++bodies;
  }
  EXPECT_GT(bodies, 0u);
}

}  // namespace
}  // namespace anigen::rig
