#include "anigen/geometry/uv_atlas/uv_atlas.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/core/parallel.h"
#include "anigen/core/random.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/geometry/sampling.h"
#include "anigen/geometry/uv_atlas/packing.h"
#include "anigen/io/gltf/gltf.h"
#include "tests/geometry/uv_atlas/surface_zoo.h"
#include "tests/support/paths.h"

namespace anigen::geometry {
namespace {

UvAtlas atlas_of(const Mesh& mesh, int size) {
  UvAtlasOptions options;
  options.size = size;
  return make_uv_atlas(mesh.vertices, mesh.faces, options);
}

/// Colours that a place has, of a few waves over an object of size one.
Eigen::Vector3f place_color(const Eigen::Vector3d& p) {
  return Eigen::Vector3d(0.5 + 0.5 * std::sin(9.0 * p.x()), 0.5 + p.y(),
                         0.5 + 0.4 * std::cos(7.0 * p.z() + 4.0 * p.x()))
      .cwiseMax(0.0)
      .cwiseMin(1.0)
      .cast<float>();
}

Mesh colored_by_place(Mesh mesh) {
  mesh.colors.clear();
  for (const Eigen::Vector3f& vertex : mesh.vertices) {
    mesh.colors.push_back(Eigen::Vector4f::Ones());
    mesh.colors.back().head<3>() = place_color(vertex.cast<double>());
  }
  return mesh;
}

/// Bilinear, as the graphics card would.
Eigen::Vector3f lookup(const LinearTexture& texture, const Eigen::Vector2d& uv) {
  const double x = uv.x() * texture.size - 0.5, y = uv.y() * texture.size - 0.5;
  const int column = static_cast<int>(std::floor(x)), row = static_cast<int>(std::floor(y));
  const auto texel = [&](int c, int r) {
    return Eigen::Vector3d(texture.texels.at(at(r) * at(texture.size) + at(c)).cast<double>());
  };
  const double right = x - column, down = y - row;
  const Eigen::Vector3d color = (1 - down) * ((1 - right) * texel(column, row) + right * texel(column + 1, row)) +
                                down * ((1 - right) * texel(column, row + 1) + right * texel(column + 1, row + 1));
  return color.cast<float>();
}

struct ColorError {
  double mean = 0.0, largest = 0.0;  ///< of a channel, in 255ths
};

/// Of the texture at random places of the mesh, against the colour there.
ColorError color_error(const Mesh& mesh, const UvAtlas& atlas, const LinearTexture& texture, std::size_t count,
                       const std::function<Eigen::Vector3f(const Eigen::Vector3d&)>& truth) {
  Rng rng(1, "places");
  ColorError error;
  for (const SurfacePoint& place : sample_surface(mesh.vertices, mesh.faces, count, rng)) {
    Eigen::Vector2d uv = Eigen::Vector2d::Zero();
    for (std::size_t k = 0; k < 3; ++k) {
      const auto corner = at(atlas.faces[at(place.face)][k]);
      uv += place.barycentric[static_cast<Eigen::Index>(k)] * atlas.uvs[corner].cast<double>();
    }
    const Eigen::Vector3f difference = lookup(texture, uv) - truth(position(place, mesh.vertices, mesh.faces));
    error.mean += 255.0 * difference.cwiseAbs().mean() / static_cast<double>(count);
    error.largest = std::max(error.largest, 255.0 * difference.cwiseAbs().maxCoeff());
  }
  return error;
}

TEST(TextureBaking, ShowsTheColoursOfTheSurface) {
  for (const Mesh& mesh : {test::round_sphere(0.5, 40, 80), test::torus(0.35, 0.13, 90, 45), test::unit_cube()}) {
    const Mesh colored = colored_by_place(mesh);
    const UvAtlas atlas = atlas_of(mesh, 512);
    const LinearTexture texture = bake_texture(atlas, mesh.vertices, colored);
    // The interpolated vertex values are the truth: within faces of the cube that is not place_color().
    const NearestSurface surface(colored);
    const auto truth = [&](const Eigen::Vector3d& p) {
      const SurfacePoint place = surface.query(p).at;
      Eigen::Vector3f color = Eigen::Vector3f::Zero();
      for (std::size_t k = 0; k < 3; ++k) {
        color += static_cast<float>(place.barycentric[static_cast<Eigen::Index>(k)]) *
                 colored.colors[at(colored.faces[at(place.face)][k])].head<3>();
      }
      return color;
    };
    const ColorError error = color_error(mesh, atlas, texture, 20000, truth);
    std::printf("%zu faces: mean error %.3f/255, largest %.2f/255\n", mesh.faces.size(), error.mean, error.largest);
    EXPECT_LT(error.mean, 0.5);
    EXPECT_LT(error.largest, 8.0);  // seams, too: the texels beside a chart go on with its colours
  }
}

TEST(TextureBaking, ASimplifiedMeshShowsTheDenseOnesColours) {
  const Mesh coarse = test::torus(0.35, 0.13, 40, 20), dense = colored_by_place(test::torus(0.35, 0.13, 400, 200));
  const UvAtlas atlas = atlas_of(coarse, 512);
  const LinearTexture texture = bake_texture(atlas, coarse.vertices, dense);
  const ColorError error = color_error(coarse, atlas, texture, 20000, place_color);
  std::printf("simplified torus: mean error %.3f/255, largest %.2f/255\n", error.mean, error.largest);
  EXPECT_LT(error.mean, 2.0);
}

TEST(TextureBaking, ARealMeshShowsItsColours) {
  const auto file = test::assets_dir() / "rigged" / "quadruped" / "naked_bunny.gltf";
  if (!std::filesystem::exists(file)) {
    GTEST_SKIP() << "no real mesh at " << file;
  }
  Asset asset = io::read_gltf(file).asset;
  normalize(asset);
  const Mesh colored = colored_by_place(asset.mesh);
  const UvAtlas atlas = atlas_of(asset.mesh, 1024);
  const LinearTexture texture = bake_texture(atlas, asset.mesh.vertices, colored);
  const ColorError error = color_error(asset.mesh, atlas, texture, 20000, place_color);
  std::printf("real mesh: mean error %.3f/255, largest %.2f/255\n", error.mean, error.largest);
  EXPECT_LT(error.mean, 2.0);
}

TEST(TextureBaking, TwentyThousandFacesAtTheDefaultSize) {
  const Mesh coarse = test::torus(0.35, 0.13, 142, 71), dense = colored_by_place(test::torus(0.35, 0.13, 640, 320));
  const auto seconds_since = [](std::chrono::steady_clock::time_point begin) {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  };
  const auto begin = std::chrono::steady_clock::now();
  const UvAtlas atlas = atlas_of(coarse, 1024);
  const auto unwrapped = std::chrono::steady_clock::now();
  const LinearTexture texture = bake_texture(atlas, coarse.vertices, dense);
  std::printf("%zu faces from %zu: unwrapping and baking %.2f s, of which baking %.2f s\n", coarse.faces.size(),
              dense.faces.size(), seconds_since(begin), seconds_since(unwrapped));
  EXPECT_LT(color_error(coarse, atlas, texture, 20000, place_color).mean, 1.0);
}

TEST(TextureBaking, ThinThingsKeepTheirSidesApart) {
  // A plate one hundredth thick, and a version of it so thin that its sides lie nearer to the other side of the plate.
  const auto plate = [](float thickness) {
    Mesh mesh = test::unit_cube();
    for (Eigen::Vector3f& vertex : mesh.vertices) vertex.z() *= thickness;
    return test::unwelded(mesh);
  };
  Mesh dense = plate(0.01F);
  for (std::size_t f = 0; f < dense.faces.size(); ++f) {
    const bool is_top = f / 2 == 4, is_bottom = f / 2 == 5;
    const Eigen::Vector4f color(is_top ? 1.0F : 0.0F, is_bottom ? 1.0F : 0.0F, 0.0F, 1.0F);
    for (int k = 0; k < 3; ++k) dense.colors.push_back(color);
  }
  Mesh thin = plate(0.01F);
  for (Eigen::Vector3f& vertex : thin.vertices) vertex.z() = vertex.z() > 0.0F ? -0.001F : -0.002F;
  const UvAtlas atlas = atlas_of(thin, 256);
  const LinearTexture texture = bake_texture(atlas, thin.vertices, dense);
  const std::vector<std::int32_t> shown = texel_faces(atlas);
  std::size_t tops = 0, wrong = 0;
  for (std::size_t t = 0; t < shown.size(); ++t) {
    if (shown[t] / 2 != 4 || shown[t] < 0) continue;
    ++tops;
    wrong += texture.texels[t].y() > 0.5F ? 1 : 0;
  }
  EXPECT_GT(tops, 10000U);
  EXPECT_EQ(wrong, 0U);
}

TEST(TextureBaking, SupersamplingAverages) {
  // Stripes four times as fine as texels: one sample per texel sees black or white, many see grey.
  Mesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}};
  mesh.faces = {{0, 1, 2}, {0, 2, 3}};
  Mesh stripes;
  constexpr int kStripes = 256;
  for (std::int32_t i = 0; i < kStripes; ++i) {
    for (int corner = 0; corner < 4; ++corner) {
      stripes.vertices.emplace_back(static_cast<float>(i + (corner & 1)) / kStripes, corner < 2 ? -1.0F : 2.0F, 0.0F);
      stripes.colors.push_back(Eigen::Vector4f::Constant(i % 2 == 0 ? 0.0F : 1.0F));
    }
    stripes.faces.push_back({4 * i, 4 * i + 1, 4 * i + 3});
    stripes.faces.push_back({4 * i, 4 * i + 3, 4 * i + 2});
  }
  const UvAtlas atlas = atlas_of(mesh, 64);
  const auto mean_contrast = [&](int supersampling) {
    TextureBakingOptions options;
    options.supersampling = supersampling;
    const LinearTexture texture = bake_texture(atlas, mesh.vertices, stripes, options);
    double sum = 0.0;
    for (const Eigen::Vector3f& texel : texture.texels) sum += std::abs(texel.x() - 0.5);
    return sum / static_cast<double>(texture.texels.size());
  };
  EXPECT_GT(mean_contrast(1), 0.4);
  EXPECT_LT(mean_contrast(8), 0.15);
}

TEST(TextureBaking, TheRestIsFilledWithColoursFromAround) {
  const Mesh mesh = test::round_sphere(0.5, 20, 40);
  Mesh colored = mesh;
  colored.colors.assign(mesh.vertices.size(), Eigen::Vector4f(0.25F, 0.5F, 0.75F, 1.0F));
  const LinearTexture texture = bake_texture(atlas_of(mesh, 100), mesh.vertices, colored);
  ASSERT_EQ(texture.texels.size(), 10000U);
  for (const Eigen::Vector3f& texel : texture.texels)
    ASSERT_LT((texel - Eigen::Vector3f(0.25F, 0.5F, 0.75F)).cwiseAbs().maxCoeff(), 1e-5F);
}

TEST(TexelFilling, ChangesSmoothlyAndKeepsWhatIsKnown) {
  for (const int size : {1, 2, 7, 33, 64}) {
    const auto count = at(size) * at(size);
    std::vector<char> known(count, 0);
    std::vector<Eigen::Vector3f> texels(count, Eigen::Vector3f::Constant(7.0F));
    known[0] = 1;
    texels[0].setZero();
    known[count - 1] = 1;
    texels[count - 1].setOnes();
    fill_unknown_texels(size, known, texels);
    for (const Eigen::Vector3f& texel : texels) {
      ASSERT_GE(texel.minCoeff(), 0.0F);
      ASSERT_LE(texel.maxCoeff(), 1.0F);
    }
    const bool is_single = size == 1;  // then the first is the last
    EXPECT_EQ(texels[0],
              is_single ? Eigen::Vector3f(Eigen::Vector3f::Ones()) : Eigen::Vector3f(Eigen::Vector3f::Zero()));
    EXPECT_EQ(texels[count - 1], Eigen::Vector3f::Ones());
    std::vector<char> none(count, 0);
    fill_unknown_texels(size, none, texels);
    for (const Eigen::Vector3f& texel : texels) ASSERT_TRUE(texel.isZero());
  }
}

TEST(TextureBaking, SameBitsOnAnyNumberOfThreadsAndProgressForEveryRow) {
  const Mesh mesh = test::torus(0.35, 0.13, 30, 20), colored = colored_by_place(mesh);
  const UvAtlas atlas = atlas_of(mesh, 128);
  const int before = thread_count();
  set_thread_count(1);
  const LinearTexture one = bake_texture(atlas, mesh.vertices, colored);
  set_thread_count(4);
  TextureBakingOptions options;
  std::vector<std::size_t> seen;
  options.progress = [&](std::size_t done, std::size_t rows) {
    EXPECT_EQ(rows, 128U);
    seen.push_back(done);
  };
  const LinearTexture four = bake_texture(atlas, mesh.vertices, colored, options);
  set_thread_count(before);
  EXPECT_TRUE(one.texels == four.texels);
  ASSERT_EQ(seen.size(), 128U);
  for (std::size_t i = 0; i < seen.size(); ++i) EXPECT_EQ(seen[i], i + 1);
}

TEST(TextureBaking, RefusesBadInput) {
  const Mesh mesh = test::unit_cube(), colored = colored_by_place(mesh);
  const UvAtlas atlas = atlas_of(mesh, 64);
  const auto refused = [&](const UvAtlas& a, const Mesh& c, int supersampling) -> std::string {
    TextureBakingOptions options;
    options.supersampling = supersampling;
    try {
      bake_texture(a, mesh.vertices, c, options);
    } catch (const InputError& error) {
      return error.place();
    }
    return "nothing";
  };
  EXPECT_EQ(refused(atlas, colored, 1), "nothing");
  EXPECT_EQ(refused(atlas, colored, 0), "supersampling");
  EXPECT_EQ(refused(atlas, colored, 9), "supersampling");
  EXPECT_EQ(refused(atlas, mesh, 1), "colored.colors");
  Mesh broken = colored;
  broken.colors[5].y() = std::numeric_limits<float>::infinity();
  EXPECT_EQ(refused(atlas, broken, 1), "colored.colors[5]");
  broken = colored;
  broken.faces.clear();
  EXPECT_EQ(refused(atlas, broken, 1), "mesh.faces");
  UvAtlas other = atlas;
  other.vertices[3] = 8;
  EXPECT_EQ(refused(other, colored, 1), "atlas.vertices[3]");
  other = atlas;
  other.uvs[2].x() = 1.5F;
  EXPECT_EQ(refused(other, colored, 1), "atlas.uvs[2]");
  other = atlas;
  other.faces[1][0] = -1;
  EXPECT_EQ(refused(other, colored, 1), "atlas.faces[1]");
  other = atlas;
  other.face_charts[4] = 6;
  EXPECT_EQ(refused(other, colored, 1), "atlas.face_charts[4]");
  other = atlas;
  other.size = 0;
  EXPECT_EQ(refused(other, colored, 1), "atlas.size");
  other = atlas;
  other.texels_per_unit = 0.0;
  EXPECT_EQ(refused(other, colored, 1), "atlas.texels_per_unit");
}

}  // namespace
}  // namespace anigen::geometry
