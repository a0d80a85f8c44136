// Real assets, moved and turned, come back onto themselves.
#include <gtest/gtest.h>

#include <filesystem>

#include "anigen/eval/align/alignment.h"
#include "anigen/io/gltf.h"
#include "tests/eval/align_shapes.h"
#include "tests/support/paths.h"

namespace anigen::eval {
namespace {

TEST(AlignAssets, JointsComeBackAfterARandomSimilarity) {
  const std::filesystem::path folder = test::assets_dir() / "rigged";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << folder << " is missing";
  std::uint64_t seed = 0;
  for (const char* name :
       {"humanoid/cesium_man.gltf", "humanoid/kaykit_knight.glb", "quadruped/khronos_fox.glb", "quadruped/q_stag.glb",
        "reptile_dragon/q_trex.glb", "fish/q_goldfish.glb", "hand/aframe_left_hand_high.glb"}) {
    if (!std::filesystem::exists(folder / name)) GTEST_SKIP() << name << " is missing";
    const io::RiggedShape truth = io::rigged_shape(io::read_gltf(folder / name).asset, name, name);
    // Around its own place: single precision vertices lose digits far from the origin.
    const Similarity unit = normalization(truth.mesh, NormalizationMode::kBoundingBox);
    const io::RiggedShape prediction = transformed(compose(test::random_similarity(++seed), unit), truth);
    const Alignment alignment = align(prediction, truth);
    for (std::size_t j = 0; j < truth.joints.size(); ++j) {
      // Also for joints far outside the mesh: well below the 1e-3 that scores may be off by.
      const Eigen::Vector3d there = alignment.truth(truth.joints.positions[j]);
      EXPECT_LT((alignment.prediction(prediction.joints.positions[j]) - there).norm(), 2e-5 * (1 + there.norm()))
          << name << ", joint " << j;
    }
  }
}

}  // namespace
}  // namespace anigen::eval
