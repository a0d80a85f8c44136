#include "anigen/io/gltf/add_animations.h"

#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "tests/io/gltf/gltf_import_support.h"
#include "tests/io/small_asset.h"
#include "tests/support/parsed_gltf.h"
#include "tests/support/paths.h"

// Animations put into a copy of a file: everything else stays, and reading gives them back.

namespace anigen::io {

namespace {

namespace fs = std::filesystem;
using test::ParsedGltf;

Animation nod(int joint) {
  Animation clip;
  clip.name = "nod";
  const double half = std::sqrt(0.5);
  clip.channels.push_back({joint,
                           ChannelPath::kRotation,
                           Interpolation::kLinear,
                           {0.0, 0.5, 1.0},
                           {0, 0, 0, 1, half, 0, 0, half, 0, 0, 0, 1}});
  clip.channels.push_back({joint, ChannelPath::kTranslation, Interpolation::kLinear, {0.0, 1.0}, {0, 0, 1, 0.5, 0, 2}});
  return clip;
}

/// World matrices of all joints at some times.
std::vector<Eigen::Matrix4d> worlds(const Asset& asset, const Animation& clip) {
  std::vector<Eigen::Matrix4d> all;
  for (const double time : {0.0, 0.3, 0.5, 0.9}) {
    for (const Eigen::Matrix4d& one : forward_kinematics(asset.skeleton.parents, sample(clip, asset.skeleton, time)))
      all.push_back(one);
  }
  return all;
}

void expect_equal_motion(const Asset& asset, const Animation& wanted, const Animation& found) {
  const auto a = worlds(asset, wanted), b = worlds(asset, found);
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_LT((a[i] - b[i]).norm(), 1e-5) << i;  // single precision
}

TEST(AddAnimations, EveryOtherEntryAndByteStays) {
  const test::TemporaryFolder folder;
  for (const fs::path& file : {folder / "plain.glb", folder / "plain.gltf"}) {
    write_gltf(file, test::small_asset());
    const Asset asset = read_gltf(file).asset;
    const fs::path out = folder / "moved.glb";
    add_animations(file, {nod(1), nod(0)}, out);
    const ParsedGltf after(out);
    if (file.extension() == ".glb") {
      const ParsedGltf before(file);
      EXPECT_EQ(after.binary.substr(0, before.binary.size()), before.binary);
      for (const auto& [key, value] : before.json.items()) {
        if (key == "buffers") continue;
        if (!value.is_array()) {
          EXPECT_EQ(after.json[key], value) << key;
          continue;
        }
        for (std::size_t i = 0; i < value.size(); ++i) EXPECT_EQ(after.json[key][i], value[i]) << key << " " << i;
        const std::set<std::string> longer = {"accessors", "bufferViews", "animations"};
        if (longer.count(key) == 0) {
          EXPECT_EQ(after.json[key].size(), value.size()) << key;
        }
      }
    }
    const Asset read = read_gltf(out).asset;
    ASSERT_EQ(read.animations.size(), asset.animations.size() + 2);
    EXPECT_EQ(read.animations[asset.animations.size()].name, "nod");
    EXPECT_EQ(read.animations.back().name, "nod_2");
    expect_equal_motion(asset, nod(1), read.animations[asset.animations.size()]);
    expect_equal_motion(asset, nod(0), read.animations.back());
    EXPECT_EQ(read.mesh.vertices, asset.mesh.vertices);
  }
}

TEST(AddAnimations, InPlaceOfTheFilesOwn) {
  const test::TemporaryFolder folder;
  Asset asset = test::small_asset();
  write_gltf(folder / "plain.glb", asset);
  AddAnimationOptions options;
  options.keep_clips = false;
  add_animations(folder / "plain.glb", {nod(1)}, folder / "moved.glb", options);
  const Asset read = read_gltf(folder / "moved.glb").asset;
  ASSERT_EQ(read.animations.size(), 1U);
  EXPECT_EQ(read.animations.front().name, "nod");
  add_animations(folder / "plain.glb", {}, folder / "still.glb", options);
  EXPECT_TRUE(read_gltf(folder / "still.glb").asset.animations.empty());
}

TEST(AddAnimations, RefusesWhatIsNoClipOfTheSkeleton) {
  const test::TemporaryFolder folder;
  write_gltf(folder / "plain.glb", test::small_asset());
  Animation stranger = nod(1000), broken = nod(1);
  broken.channels[0].values[2] = std::numeric_limits<double>::quiet_NaN();
  for (const Animation* bad : {&stranger, &broken})
    EXPECT_THROW(add_animations(folder / "plain.glb", {*bad}, folder / "out.glb"), InputError);
  EXPECT_THROW(add_animations(folder / "none.glb", {nod(0)}, folder / "out.glb"), InputError);
  EXPECT_THROW(add_animations(folder / "plain.glb", {nod(0)}, folder / "out.txt"), InputError);
  EXPECT_FALSE(fs::exists(folder / "out.glb"));
}

TEST(AddAnimations, RealFilesReadBackAsTheyWereAnimated) {
  std::size_t files = 0;
  for (const char* name : {"quadruped/khronos_fox.glb", "humanoid/cesium_man.gltf", "arthropod/q_spider.glb",
                           "creature/dcl_octopus_npc.glb", "synthetic/godot_nested_skeletons.glb"}) {
    const fs::path file = test::assets_dir() / "rigged" / name;
    if (!fs::exists(file)) continue;
    ++files;
    SCOPED_TRACE(name);
    ImportOptions options;
    options.require_rig = false;
    const Asset asset = read_gltf(file, options).asset;
    // All joints turn a little more, so that every prefix of the import is undone.
    Animation clip;
    clip.name = "all";
    for (std::size_t j = 0; j < asset.skeleton.size(); ++j) {
      Channel channel{static_cast<int>(j), ChannelPath::kRotation, Interpolation::kLinear, {0.0, 1.0}, {}};
      for (const double angle : {0.0, 0.4}) {
        const Eigen::Quaterniond q =
            asset.skeleton.rest[j].rotation * Eigen::AngleAxisd(angle, Eigen::Vector3d(0.6, 0.0, 0.8));
        channel.values.insert(channel.values.end(), {q.x(), q.y(), q.z(), q.w()});
      }
      clip.channels.push_back(channel);
    }
    const test::TemporaryFolder folder;
    add_animations(file, {clip}, folder / "moved.glb");
    const Asset read = read_gltf(folder / "moved.glb", options).asset;
    ASSERT_EQ(read.skeleton.size(), asset.skeleton.size());
    const double size = bounding_box(asset.mesh.vertices).diagonal();
    for (const double time : {0.0, 1.0}) {
      const auto a = skin_vertices(asset, sample(clip, asset.skeleton, time));
      const auto b = skin_vertices(read, sample(read.animations.back(), read.skeleton, time));
      ASSERT_EQ(a.size(), b.size());
      double largest = 0.0;
      for (std::size_t v = 0; v < a.size(); ++v) {
        const Influence* row = asset.skin.row(v);
        // A mesh on a root that the importer made has no node above it that could move.
        const bool rests =
            std::any_of(row, row + asset.skin.row_size(v), [](const Influence& i) { return i.joint == 0; });
        if (!rests) largest = std::max<double>(largest, (a[v] - b[v]).norm());
      }
      EXPECT_LT(largest, 1e-4 * size);
    }
  }
  if (files == 0) GTEST_SKIP() << "no real assets in " << test::assets_dir();
}

}  // namespace

}  // namespace anigen::io
