#include "anigen/render/surface_color.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/random.h"
#include "anigen/geometry/sampling.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/render/scene.h"
#include "tests/render/shapes.h"
#include "tests/support/paths.h"

namespace anigen::render {
namespace {

/// Linear RGB.
Eigen::Vector3f color_of_place(const Eigen::Vector3d& p) {
  const Eigen::Vector3d color(0.5 + 0.5 * std::sin(6.0 * p.x()), 0.5 + 0.9 * p.y(), 0.5 + 0.4 * std::cos(5.0 * p.z()));
  return color.cwiseMax(0.0).cwiseMin(1.0).cast<float>();
}

Mesh colored_by_place(Mesh mesh) {
  mesh.colors.clear();
  for (const Eigen::Vector3f& vertex : mesh.vertices) {
    mesh.colors.push_back(Eigen::Vector4f::Ones());
    mesh.colors.back().head<3>() = color_of_place(vertex.cast<double>());
  }
  return mesh;
}

/// A ball on two joints, with colours and a material that a texture is to replace.
Asset rigged_ball() {
  Asset asset = test::sphere(0.5F, 24, 48);
  asset.skeleton = skeleton_from_joints({{0, 0, -0.25}, {0, 0, 0.25}}, {-1, 0}, {"root", "top"});
  for (const Eigen::Vector3f& vertex : asset.mesh.vertices) {
    const float upper = std::clamp(0.5F + vertex.z(), 0.0F, 1.0F);
    asset.skin.append_row({{0, 1.0F - upper}, {1, upper}});
  }
  asset.mesh.colors.assign(asset.mesh.vertices.size(), Eigen::Vector4f(1, 0, 0, 1));
  asset.materials.emplace_back();
  asset.mesh.face_materials.assign(asset.mesh.faces.size(), 0);
  return asset;
}

/// Mean difference in 255ths, in sRGB as it is seen, between the texture at random places and the colour there.
double mean_difference(const Asset& asset) {
  const Texture texture(asset.images.at(0), "texture");
  const Mesh& mesh = asset.mesh;
  Rng rng(1, "places");
  double sum = 0.0;
  constexpr std::size_t kPlaces = 10000;
  for (const auto& place : geometry::sample_surface(mesh.vertices, mesh.faces, kPlaces, rng)) {
    Eigen::Vector2f uv = Eigen::Vector2f::Zero();
    for (std::size_t k = 0; k < 3; ++k) {
      uv += static_cast<float>(place.barycentric[static_cast<Eigen::Index>(k)]) *
            mesh.uvs[at(mesh.faces[at(place.face)][k])];
    }
    const Eigen::Vector3f shown = texture.lookup(uv).unaryExpr([](float value) { return linear_to_srgb(value); });
    const Eigen::Vector3f truth =
        color_of_place(geometry::position(place, mesh.vertices, mesh.faces)).unaryExpr([](float value) {
          return linear_to_srgb(value);
        });
    sum += 255.0 * (shown - truth).cwiseAbs().mean() / static_cast<double>(kPlaces);
  }
  return sum;
}

Asset written_and_read(const Asset& asset) {
  const test::TemporaryFolder folder;
  io::write_gltf(folder / "asset.glb", asset);
  return io::read_gltf(folder / "asset.glb").asset;
}

void expect_survives_export(const Asset& asset) {
  const Asset read = written_and_read(asset);
  ASSERT_EQ(read.mesh.faces, asset.mesh.faces);
  ASSERT_EQ(read.mesh.uvs.size(), asset.mesh.uvs.size());
  for (std::size_t v = 0; v < read.mesh.uvs.size(); ++v) ASSERT_EQ(read.mesh.uvs[v], asset.mesh.uvs[v]);
  ASSERT_EQ(read.images.size(), 1U);
  EXPECT_EQ(read.images[0].bytes, asset.images[0].bytes);
  ASSERT_EQ(read.materials.size(), 1U);
  EXPECT_EQ(read.materials[0].image, 0);
  EXPECT_EQ(read.materials[0].base_color, Eigen::Vector4f(Eigen::Vector4f::Ones()));
  EXPECT_TRUE(read.mesh.colors.empty());
  EXPECT_EQ(read.skeleton.size(), asset.skeleton.size());
  EXPECT_LT(mean_difference(read), 2.0);
}

TEST(TexturedAsset, ColoursSurviveExport) {
  const Asset ball = rigged_ball();
  TextureOptions options;
  options.atlas.size = 512;
  const TexturedAsset textured = textured_asset(ball, colored_by_place(test::sphere(0.5F, 96, 192).mesh), options);
  EXPECT_TRUE(validate(textured.asset).empty()) << validate(textured.asset).front();
  EXPECT_GT(textured.occupancy, 0.55);
  EXPECT_GT(textured.charts, 5U);
  const Texture texture(textured.asset.images.at(0), "texture");
  EXPECT_TRUE(texture.opaque());
  std::printf("mean difference %.3f/255\n", mean_difference(textured.asset));
  expect_survives_export(textured.asset);
}

TEST(TexturedAsset, PartsMoveAndShadeAsBefore) {
  const Asset ball = rigged_ball();
  TextureOptions options;
  options.atlas.size = 128;
  const Asset textured = textured_asset(ball, colored_by_place(ball.mesh), options).asset;
  ASSERT_EQ(textured.skin.rows(), textured.mesh.vertices.size());
  ASSERT_EQ(textured.mesh.faces.size(), ball.mesh.faces.size());
  Pose pose = bind_pose(ball.skeleton);
  pose[1].rotation = Eigen::Quaterniond(Eigen::AngleAxisd(0.7, Eigen::Vector3d::UnitX()));
  const std::vector<Eigen::Vector3f> before = skin_vertices(ball, pose), after = skin_vertices(textured, pose);
  for (std::size_t f = 0; f < ball.mesh.faces.size(); ++f) {
    for (std::size_t k = 0; k < 3; ++k) {
      const auto old_vertex = at(ball.mesh.faces[f][k]), vertex = at(textured.mesh.faces[f][k]);
      ASSERT_EQ(after[vertex], before[old_vertex]);
      ASSERT_EQ(textured.mesh.normals[vertex], ball.mesh.normals[old_vertex]);
    }
  }
}

TEST(TexturedAsset, ARealAssetSurvivesExport) {
  const auto file = test::assets_dir() / "rigged" / "humanoid" / "cesium_man.gltf";
  if (!std::filesystem::exists(file)) {
    GTEST_SKIP() << "no real mesh at " << file;
  }
  Asset asset = io::read_gltf(file).asset;
  normalize(asset);
  const TexturedAsset textured = textured_asset(asset, colored_by_place(asset.mesh));
  EXPECT_TRUE(validate(textured.asset).empty());
  EXPECT_EQ(textured.asset.animations.size(), asset.animations.size());
  std::printf("%zu charts, occupancy %.3f, mean difference %.3f/255\n", textured.charts, textured.occupancy,
              mean_difference(textured.asset));
  expect_survives_export(textured.asset);
}

TEST(TexturedAsset, RefusesArraysOfOtherLengths) {
  const Asset ball = rigged_ball();
  const auto refused = [](const Asset& asset, const Mesh& colored) -> std::string {
    TextureOptions options;
    options.atlas.size = 64;
    try {
      textured_asset(asset, colored, options);
    } catch (const InputError& error) {
      return error.place();
    }
    return "nothing";
  };
  const Mesh colored = colored_by_place(ball.mesh);
  EXPECT_EQ(refused(ball, colored), "nothing");
  Asset broken = ball;
  broken.skin.append_row({{0, 1.0F}});
  EXPECT_EQ(refused(broken, colored), "skin");
  broken = ball;
  broken.mesh.normals.pop_back();
  EXPECT_EQ(refused(broken, colored), "mesh.normals");
  Mesh plain = colored;
  plain.colors.clear();
  EXPECT_EQ(refused(ball, plain), "colored.colors");
}

}  // namespace
}  // namespace anigen::render
