// Import, export, import again: nothing that users rely on may change.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <map>
#include <numeric>

#include "anigen/asset/rigged_asset.h"
#include "anigen/io/gltf/gltf.h"
#include "tests/io/small_asset.h"
#include "tests/support/paths.h"

namespace anigen::io {
namespace {

namespace fs = std::filesystem;

ExportOptions everything(const Asset& asset) {
  ExportOptions options;
  options.influences = std::max<std::size_t>(4, asset.skin.largest_row());
  return options;
}

Asset there_and_back(const Asset& asset, const ExportOptions& options, const std::string& extension = ".glb") {
  const test::TemporaryFolder folder;
  write_gltf(folder / (asset.name + extension), asset, options);
  return read_gltf(folder / (asset.name + extension)).asset;
}

template <typename Vector>
void expect_near(const std::vector<Vector>& before, const std::vector<Vector>& after, double tolerance,
                 const char* what) {
  ASSERT_EQ(before.size(), after.size()) << what;
  double worst = 0.0;
  for (std::size_t i = 0; i < before.size(); ++i)
    worst = std::max(worst, static_cast<double>((before[i] - after[i]).cwiseAbs().maxCoeff()));
  EXPECT_LE(worst, tolerance) << what;
}

// Export groups the faces by material and keeps their order within a group.
std::vector<std::size_t> grouped_order(const Mesh& mesh) {
  std::vector<std::size_t> order(mesh.faces.size());
  std::iota(order.begin(), order.end(), 0);
  if (mesh.face_materials.empty()) return order;
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return mesh.face_materials[a] < mesh.face_materials[b]; });
  return order;
}

Material material_of(const Asset& asset, std::size_t face) {
  const int index = asset.mesh.face_materials.empty() ? -1 : asset.mesh.face_materials[face];
  return index < 0 ? Material{} : asset.materials[static_cast<std::size_t>(index)];
}

void expect_same_materials(const Asset& before, const Asset& after) {
  const std::vector<std::size_t> order = grouped_order(before.mesh);
  ASSERT_EQ(before.mesh.faces.size(), after.mesh.faces.size());
  for (std::size_t f = 0; f < order.size(); ++f) {
    ASSERT_EQ(before.mesh.faces[order[f]], after.mesh.faces[f]) << "face " << f;
    const Material a = material_of(before, order[f]), b = material_of(after, f);
    ASSERT_LE((a.base_color - b.base_color).cwiseAbs().maxCoeff(), 1e-6f) << "face " << f;
    ASSERT_EQ(a.double_sided, b.double_sided) << "face " << f;
    const bool is_textured = a.image >= 0 && !before.mesh.uvs.empty();
    ASSERT_EQ(is_textured, b.image >= 0) << "face " << f;
    if (is_textured) {
      const EncodedImage& one = before.images[static_cast<std::size_t>(a.image)];
      const EncodedImage& two = after.images[static_cast<std::size_t>(b.image)];
      ASSERT_TRUE(one.bytes == two.bytes) << "face " << f;
    }
  }
}

void expect_same_weights(const SkinWeights& before, const SkinWeights& after) {
  ASSERT_EQ(before.rows(), after.rows());
  double worst = 0.0;
  for (std::size_t v = 0; v < before.rows(); ++v) {
    std::map<int, double> difference;
    for (std::size_t i = 0; i < before.row_size(v); ++i) difference[before.row(v)[i].joint] += before.row(v)[i].weight;
    for (std::size_t i = 0; i < after.row_size(v); ++i) difference[after.row(v)[i].joint] -= after.row(v)[i].weight;
    for (const auto& [joint, weight] : difference) worst = std::max(worst, std::abs(weight));
  }
  EXPECT_LE(worst, 1e-6) << "weights";
}

// Largest differences of the linear part (relative to the matrix) and of the position (relative to its distance from
// the origin, at least the diagonal: single precision resolves no more).
struct MatrixDifference {
  double linear, position;
};

MatrixDifference difference_of(const Eigen::Matrix4d& a, const Eigen::Matrix4d& b, double diagonal) {
  const Eigen::Matrix4d difference = a - b;
  const double scale = a.topLeftCorner<3, 3>().cwiseAbs().maxCoeff();
  const double distance = std::max(diagonal, a.topRightCorner<3, 1>().norm());
  return {difference.topLeftCorner<3, 3>().cwiseAbs().maxCoeff() / scale,
          difference.topRightCorner<3, 1>().norm() / distance};
}

void expect_near_matrix(const Eigen::Matrix4d& before, const Eigen::Matrix4d& after, double diagonal,
                        const std::string& what) {
  const MatrixDifference difference = difference_of(before, after, diagonal);
  EXPECT_LE(difference.linear, 1e-5) << what;
  EXPECT_LE(difference.position, 2e-6) << what;
}

void expect_same_skeleton(const Skeleton& before, const Skeleton& after, double diagonal) {
  ASSERT_EQ(before.names, after.names);
  ASSERT_EQ(before.parents, after.parents);
  const auto rest_before = forward_kinematics(before.parents, before.rest);
  const auto rest_after = forward_kinematics(after.parents, after.rest);
  for (std::size_t j = 0; j < before.size(); ++j) {
    expect_near_matrix(before.bind[j], after.bind[j], diagonal, "bind of " + before.names[j]);
    expect_near_matrix(rest_before[j], rest_after[j], diagonal, "rest of " + before.names[j]);
  }
}

// Keys that fall on one float are merged; everything else keeps its keys.
std::size_t distinct_times(const Channel& channel) {
  std::vector<float> times(channel.times.begin(), channel.times.end());
  return static_cast<std::size_t>(std::unique(times.begin(), times.end()) - times.begin());
}

void expect_same_animations(const Asset& before, const Asset& after) {
  ASSERT_EQ(before.animations.size(), after.animations.size());
  const double diagonal = bounding_box(before.mesh.vertices).diagonal();
  for (std::size_t a = 0; a < before.animations.size(); ++a) {
    const Animation &one = before.animations[a], &two = after.animations[a];
    EXPECT_EQ(one.name, two.name);
    ASSERT_EQ(one.channels.size(), two.channels.size()) << one.name;
    for (std::size_t c = 0; c < one.channels.size(); ++c) {
      EXPECT_EQ(one.channels[c].joint, two.channels[c].joint);
      EXPECT_EQ(one.channels[c].path, two.channels[c].path);
      EXPECT_EQ(distinct_times(one.channels[c]), two.channels[c].times.size()) << one.name << " channel " << c;
    }
    for (const double part : {0.0, 0.37, 0.81, 1.0}) {
      const double t = part * one.duration();
      const auto world_one = forward_kinematics(before.skeleton.parents, sample(one, before.skeleton, t));
      const auto world_two = forward_kinematics(after.skeleton.parents, sample(two, after.skeleton, t));
      for (std::size_t j = 0; j < world_one.size(); ++j) {
        // Float keys along a chain of joints; a step may fall to either side of a time that was rounded.
        const MatrixDifference difference = difference_of(world_one[j], world_two[j], diagonal);
        EXPECT_LE(difference.linear, 1e-4) << one.name << " joint " << j << " at " << t;
        EXPECT_LE(difference.position, 1e-4) << one.name << " joint " << j << " at " << t;
      }
    }
  }
}

void expect_same_asset(const Asset& before, const Asset& after) {
  const double diagonal = bounding_box(before.mesh.vertices).diagonal();
  EXPECT_EQ(before.name, after.name);
  expect_near(before.mesh.vertices, after.mesh.vertices, 1e-6 * diagonal, "positions");
  expect_near(before.mesh.normals, after.mesh.normals, 1e-5, "normals");
  expect_near(before.mesh.uvs, after.mesh.uvs, 0.0, "uvs");
  expect_near(before.mesh.colors, after.mesh.colors, 0.0, "colours");
  expect_same_materials(before, after);
  expect_same_weights(before.skin, after.skin);
  expect_same_skeleton(before.skeleton, after.skeleton, diagonal);
  if (!::testing::Test::HasFatalFailure()) expect_same_animations(before, after);
}

std::vector<fs::path> real_assets() {
  std::vector<fs::path> files;
  const fs::path folder = test::assets_dir() / "rigged";
  if (!fs::exists(folder)) return files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.path().extension() == ".glb" || entry.path().extension() == ".gltf") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

class GltfRoundTripOfFile : public ::testing::TestWithParam<fs::path> {};
GTEST_ALLOW_UNINSTANTIATED_PARAMETERIZED_TEST(GltfRoundTripOfFile);

TEST_P(GltfRoundTripOfFile, KeepsEverything) {
  const Asset before = read_gltf(GetParam()).asset;  // every asset of the folder can be read
  expect_same_asset(before, there_and_back(before, everything(before)));
}

INSTANTIATE_TEST_SUITE_P(RealAssets, GltfRoundTripOfFile, ::testing::ValuesIn(real_assets()), [](const auto& info) {
  std::string name = info.param.stem().string();
  for (char& c : name) c = std::isalnum(static_cast<unsigned char>(c)) != 0 ? c : '_';
  return name;
});

TEST(GltfRoundTrip, RealAssetsWereFound) {
  if (!fs::exists(test::assets_dir())) {
    GTEST_SKIP() << "no rigged assets in " << test::assets_dir();
  }
  EXPECT_FALSE(real_assets().empty()) << "nothing to read below " << test::assets_dir();
}

TEST(GltfRoundTrip, SmallAssetInBothContainers) {
  const Asset asset = test::small_asset();
  expect_same_asset(asset, there_and_back(asset, everything(asset), ".glb"));
  expect_same_asset(asset, there_and_back(asset, everything(asset), ".gltf"));
}

TEST(GltfRoundTrip, ManyInfluencesAndManyJoints) {
  const Asset many_influences = test::small_asset(12, 20, 11);
  expect_same_asset(many_influences, there_and_back(many_influences, everything(many_influences)));
  const Asset many_joints = test::small_asset(300, 310, 3);
  expect_same_asset(many_joints, there_and_back(many_joints, everything(many_joints)));
}

TEST(GltfRoundTrip, WithoutMaterialsNormalsUvsAndColours) {
  Asset asset = test::small_asset();
  asset.materials.clear();
  asset.images.clear();
  asset.mesh.face_materials.clear();
  asset.mesh.normals.clear();
  asset.mesh.uvs.clear();
  asset.mesh.colors.clear();
  asset.animations.clear();
  expect_same_asset(asset, there_and_back(asset, everything(asset)));
}

TEST(GltfRoundTrip, FourInfluencesAreTheHeaviest) {
  const Asset asset = test::small_asset(9, 20, 7);
  expect_same_weights(limit_influences(asset.skin, 4), there_and_back(asset, ExportOptions{}).skin);
}

TEST(GltfRoundTrip, PublishedAxesTurnTheAssetByHalfATurnAboutTheVertical) {
  const Asset asset = test::small_asset(4);
  ExportOptions options = everything(asset);
  options.axes = ExportAxes::kPublished;
  const Asset turned = there_and_back(asset, options);
  // (x, y, z) → (−x, z, y) in the file, which the import reads as (−x, −y, z).
  std::vector<Eigen::Vector3f> expected;
  for (const Eigen::Vector3f& v : asset.mesh.vertices) expected.emplace_back(-v.x(), -v.y(), v.z());
  expect_near(expected, turned.mesh.vertices, 1e-6, "positions");
  // Poses turn with it, animated ones too.
  for (const double t : {0.0, 0.3, 0.9}) {
    const auto before = skin_vertices(asset, sample(asset.animations[0], asset.skeleton, t));
    const auto after = skin_vertices(turned, sample(turned.animations[0], turned.skeleton, t));
    std::vector<Eigen::Vector3f> turned_before;
    for (const Eigen::Vector3f& v : before) turned_before.emplace_back(-v.x(), -v.y(), v.z());
    expect_near(turned_before, after, 1e-5, "posed positions");
  }
}

TEST(GltfRoundTrip, PosesSurviveWhereTheRootRestsAwayFromItsBindPose) {
  // glTF fixes a bind pose only up to one matrix; the importer chooses the one in which the root rests.
  Asset asset = test::small_asset(4);
  asset.skeleton.rest[0].rotation = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized());
  asset.skeleton.rest[0].translation += Eigen::Vector3d(0.1, -0.2, 0.3);
  const Asset again = there_and_back(asset, everything(asset));
  expect_near(skin_vertices(asset, asset.skeleton.rest), skin_vertices(again, again.skeleton.rest), 2e-6, "at rest");
  for (const double t : {0.0, 0.4, 1.0}) {
    expect_near(skin_vertices(asset, sample(asset.animations[0], asset.skeleton, t)),
                skin_vertices(again, sample(again.animations[0], again.skeleton, t)), 1e-5, "posed");
  }
}

}  // namespace
}  // namespace anigen::io
