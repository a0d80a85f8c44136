#include "anigen/raster/rasterize.h"

#include <ATen/Parallel.h>
#include <gtest/gtest.h>

#include <limits>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "tests/raster/raster_meshes.h"
#include "tests/raster/slow_rasterizer.h"

namespace anigen::raster {
namespace {

// Number of triangles that cover each pixel: every triangle drawn alone.
Tensor coverage_count(const ClipMesh& mesh, std::int64_t height, std::int64_t width, std::int64_t bits) {
  Tensor count = torch::zeros({height, width}, torch::kInt64);
  for (std::int64_t f = 0; f < mesh.faces.size(0); ++f)
    count += (rasterize(mesh.clip, mesh.faces.narrow(0, f, 1), height, width, bits).triangle > 0).to(torch::kInt64);
  return count;
}

bool all_ones(const Tensor& count) { return (count == 1).all().item<bool>(); }

TEST(Rasterize, FollowsTheDefinitionOnRandomTriangles) {
  constexpr std::int64_t kHeight = 40, kWidth = 56;
  for (const bool behind : {false, true}) {
    for (int seed = 0; seed < 6; ++seed) {
      torch::manual_seed(seed);
      const ClipMesh soup = triangle_soup(12, behind);
      const Fragments found = rasterize(soup.clip, soup.faces, kHeight, kWidth, 12);
      const std::vector<SlowPixel> wanted = slow_rasterize(soup.clip, soup.faces, kHeight, kWidth);
      const Tensor uv = found.barycentric.view({-1, 2}), depth = found.depth.view({-1}), id = found.triangle.view({-1});
      std::size_t sure = 0;
      for (std::size_t i = 0; i < wanted.size(); ++i) {
        if (!wanted[i].sure) continue;
        ++sure;
        const auto pixel = static_cast<std::int64_t>(i);
        const std::string where = "seed " + std::to_string(seed) + ", pixel " + std::to_string(pixel);
        ASSERT_EQ(id[pixel].item<std::int64_t>(), wanted[i].triangle) << where << (behind ? ", behind" : "");
        // Two ways to the same numbers in fp64, of triangles that may be nearly edge on.
        EXPECT_NEAR(uv[pixel][0].item<double>(), wanted[i].u, 1e-8) << where;
        EXPECT_NEAR(uv[pixel][1].item<double>(), wanted[i].v, 1e-8) << where;
        EXPECT_NEAR(depth[pixel].item<double>(), wanted[i].depth, 1e-8) << where;
      }
      EXPECT_GT(sure, wanted.size() * 8 / 10);
    }
  }
}

TEST(Rasterize, EveryPixelOfATessellatedSquareIsCoveredOnce) {
  torch::manual_seed(3);
  ClipMesh mesh = clip_grid(7, 5, 1.3);
  // Corners off the border move, and every vertex gets a w of its own, which does not move it on the screen.
  mesh.clip.narrow(1, 0, 2).add_(0.08 * torch::rand({mesh.clip.size(0), 2}, torch::kFloat64));
  mesh.clip.mul_(0.5 + 3.0 * torch::rand({mesh.clip.size(0), 1}, torch::kFloat64));
  for (const std::int64_t bits : {1, 4, 12}) EXPECT_TRUE(all_ones(coverage_count(mesh, 37, 53, bits))) << bits;
}

TEST(Rasterize, EdgesThroughPixelCentresBelongToOneTriangle) {
  // 16 x 16 cells of a grid four pixels wide, shifted by half a pixel: every edge passes through pixel centres.
  ClipMesh mesh = clip_grid(18, 18, 18.0 / 16.0);
  mesh.clip.narrow(1, 0, 2).add_(1.0 / 64.0);
  EXPECT_TRUE(all_ones(coverage_count(mesh, 64, 64, 4)));
}

TEST(Rasterize, TopAndLeftEdgesCount) {
  // The square from the centre of pixel (1, 1) to that of pixel (5, 5) of 8.
  const double low = 2.0 * 1.5 / 8.0 - 1.0, high = 2.0 * 5.5 / 8.0 - 1.0;
  const Tensor clip = clip_points({low, low, 0, 1, high, low, 0, 1, high, high, 0, 1, low, high, 0, 1});
  Tensor wanted = torch::zeros({8, 8}, torch::kBool);
  wanted.narrow(0, 1, 4).narrow(1, 1, 4).fill_(true);
  const std::vector<std::int64_t> turns[] = {{0, 1, 2, 0, 2, 3}, {2, 1, 0, 3, 2, 0}};
  for (const std::vector<std::int64_t>& corners : turns) {
    const Tensor faces = torch::tensor(corners, torch::kInt64).view({2, 3});
    EXPECT_TRUE(torch::equal(rasterize(clip, faces, 8, 8).triangle > 0, wanted));
  }
}

TEST(Rasterize, TessellationsCutAtTheCameraAndFarOutsideHaveNoGaps) {
  torch::manual_seed(5);
  // Far larger than the band outside of which triangles are cut.
  ClipMesh wide = clip_grid(5, 4, 3e4);
  wide.clip.narrow(1, 0, 2).add_(100.0 * torch::rand({wide.clip.size(0), 2}, torch::kFloat64));
  EXPECT_TRUE(all_ones(coverage_count(wide, 40, 40, 4)));
  // A floor that passes under the camera: grid x → screen x, grid y → w from −3 to 3, one below the eye.
  ClipMesh ground = clip_grid(9, 8, 3.0);
  ground.clip.select(1, 0).mul_(10.0);
  ground.clip.select(1, 3).copy_(ground.clip.select(1, 1));
  ground.clip.select(1, 1).fill_(1.0);
  const Tensor count = coverage_count(ground, 60, 60, 4);
  EXPECT_LE(count.max().item<std::int64_t>(), 1);
  // y/w = 1/w: from 1/3, at the far end, on. w itself must exceed |z| = 0 only.
  EXPECT_TRUE(all_ones(count.narrow(0, 41, 19)));
  EXPECT_EQ(count.narrow(0, 0, 39).sum().item<std::int64_t>(), 0);
}

TEST(Rasterize, HugeCoordinatesCoverThePicture) {
  const Tensor clip = clip_points({-1e30, -1e30, 0, 1, 3e30, -1e30, 0, 1, -1e30, 3e30, 0.5, 1});
  for (const torch::Dtype dtype : {torch::kFloat32, torch::kFloat64}) {
    const Fragments found = rasterize(clip.to(dtype), separate_faces(1), 9, 7);
    EXPECT_TRUE((found.triangle == 1).all().item<bool>());
    const Tensor uv = found.barycentric.to(torch::kFloat64).view({-1, 2});
    EXPECT_LT((uv.select(1, 0) - 0.5).abs().max().item<double>(), 1e-6);
    EXPECT_LT((uv.select(1, 1) - 0.25).abs().max().item<double>(), 1e-6);
    EXPECT_LT((found.depth - 0.125).abs().max().item<double>(), 1e-6);
    EXPECT_EQ(found.barycentric.scalar_type(), dtype);
  }
}

TEST(Rasterize, BarycentricsArePerspectiveCorrect) {
  // An edge from w = 1 to w = 3 across the picture: its projected middle is a quarter along it.
  const Tensor clip = clip_points({-1, -1, 0, 1, 3, -3, 0, 3, -1, 3, 0, 1});
  const Fragments found = rasterize(clip, separate_faces(1), 1, 1);
  // At (0, 0): q = (-1, -1), (3, -3), (-1, 3), weights 6, 4, 6.
  EXPECT_NEAR(found.barycentric[0][0][0].item<double>(), 6.0 / 16.0, 1e-12);
  EXPECT_NEAR(found.barycentric[0][0][1].item<double>(), 4.0 / 16.0, 1e-12);
}

TEST(Rasterize, TheFirstOfEquallyNearTrianglesShows) {
  const Tensor clip = clip_points({-3, -1, 0.2, 1, 3, -1, 0.2, 1, 0, 5, 0.2, 1});
  const Tensor faces = torch::zeros({4, 1}, torch::kInt64) + torch::arange(3, torch::kInt64).unsqueeze(0);
  EXPECT_TRUE((rasterize(clip, faces, 4, 4).triangle == 1).all().item<bool>());
}

TEST(Rasterize, WhatIsBehindTheCameraOrOutOfDepthDoesNotShow) {
  const Tensor inside = clip_points({-3, -1, 0, 1, 3, -1, 0, 1, 0, 5, 0, 1});
  EXPECT_TRUE((rasterize(inside, separate_faces(1), 4, 4).triangle > 0).all().item<bool>());
  EXPECT_FALSE((rasterize(-inside, separate_faces(1), 4, 4).triangle > 0).any().item<bool>());
  for (const double z : {-1.01, 1.01}) {
    Tensor moved = inside.clone();
    moved.select(1, 2).fill_(z);
    EXPECT_FALSE((rasterize(moved, separate_faces(1), 4, 4).triangle > 0).any().item<bool>()) << z;
  }
  Tensor on_eye = inside.clone();
  on_eye.fill_(0.0);
  EXPECT_FALSE((rasterize(on_eye, separate_faces(1), 4, 4).triangle > 0).any().item<bool>());
}

TEST(Rasterize, DegenerateTrianglesAreHarmless) {
  // A point, a line, the same vertex twice, and a needle thinner than any number can tell.
  const double just_above = 0.25 + 1e-17;
  const Tensor clip = clip_points({0,    0,   0, 1, 0,   0,    0, 1, 0,   0,          0, 1,  //
                                   -1,   -1,  0, 1, 1,   1,    0, 1, 0.1, 0.1,        0, 1,  //
                                   -1,   0.3, 0, 1, -1,  0.3,  0, 1, 0.5, 0.2,        0, 1,  //
                                   -0.9, 0.7, 0, 1, 0.9, -0.2, 0, 1, 0.0, just_above, 0, 1});
  const Tensor positions = clip.clone().requires_grad_();
  const Fragments found = rasterize(positions, separate_faces(4), 33, 33);
  EXPECT_TRUE(found.barycentric.isfinite().all().item<bool>());
  EXPECT_TRUE(found.depth.isfinite().all().item<bool>());
  found.barycentric.sum().backward();
  EXPECT_TRUE(positions.grad().isfinite().all().item<bool>());
}

TEST(Rasterize, EmptyMeshGivesAnEmptyPicture) {
  const Tensor clip = torch::zeros({0, 4}).requires_grad_(), faces = torch::zeros({0, 3}, torch::kInt64);
  const Fragments found = rasterize(clip, faces, 3, 5);
  EXPECT_EQ(found.triangle.sizes(), (std::vector<std::int64_t>{3, 5}));
  EXPECT_EQ(found.triangle.abs().sum().item<std::int64_t>(), 0);
  EXPECT_EQ(found.depth.abs().sum().item<float>(), 0.0f);
  const Tensor image = interpolate(torch::zeros({0, 2}), found, faces);
  EXPECT_EQ(image.sizes(), (std::vector<std::int64_t>{3, 5, 2}));
  image.sum().backward();
  EXPECT_EQ(clip.grad().sizes(), (std::vector<std::int64_t>{0, 4}));
}

TEST(Rasterize, TheSameBitsForAnyNumberOfThreads) {
  torch::manual_seed(8);
  const int before = at::get_num_threads();
  const ClipMesh soup = triangle_soup(700, true);
  const Tensor attributes = torch::randn({soup.clip.size(0), 3}), direction = torch::randn({50, 70, 3});
  std::vector<Tensor> first;
  for (const int threads : {1, 2, 3, 5}) {
    at::set_num_threads(threads);
    const Tensor clip = soup.clip.to(torch::kFloat32).requires_grad_(), table = attributes.clone().requires_grad_();
    const Fragments found = rasterize(clip, soup.faces, 50, 70);
    const Tensor image = interpolate(table, found, soup.faces);
    const auto gradients = torch::autograd::grad({image}, {clip, table}, {direction});
    const std::vector<Tensor> all{found.triangle, found.depth, image.detach(), gradients[0], gradients[1]};
    if (first.empty()) first = all;
    for (std::size_t i = 0; i < all.size(); ++i) EXPECT_TRUE(torch::equal(all[i], first[i])) << threads << ", " << i;
  }
  at::set_num_threads(before);
}

std::string message_of(const Tensor& clip, const Tensor& faces) {
  try {
    rasterize(clip, faces, 4, 4);
  } catch (const InputError& error) {
    return error.what();
  }
  return "nothing thrown";
}

TEST(Rasterize, BadInputIsNamed) {
  const Tensor clip = clip_points({-3, -1, 0, 1, 3, -1, 0, 1, 0, 5, 0, 1}), faces = separate_faces(1);
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    Tensor broken = clip.clone();
    broken[1][2].fill_(bad);
    EXPECT_NE(message_of(broken, faces).find("vertex 1"), std::string::npos) << message_of(broken, faces);
  }
  EXPECT_NE(message_of(clip, faces + 1).find("vertex 3 of 3"), std::string::npos);
  EXPECT_NE(message_of(clip, faces - 1).find("triangle 0"), std::string::npos);
  EXPECT_THROW(rasterize(clip.narrow(1, 0, 3), faces, 4, 4), InputError);
  EXPECT_THROW(rasterize(clip.to(torch::kHalf), faces, 4, 4), InputError);
  EXPECT_THROW(rasterize(Tensor(), faces, 4, 4), InputError);
  EXPECT_THROW(rasterize(clip, faces.to(torch::kInt32), 4, 4), InputError);
  EXPECT_THROW(rasterize(clip, faces, 0, 4), InputError);
  EXPECT_THROW(rasterize(clip, faces, 4, std::int64_t{1} << 40), InputError);
  EXPECT_THROW(rasterize(clip, faces, 4, 4, 0), InputError);
  EXPECT_THROW(rasterize(clip, faces, 4, 4, 13), InputError);
}

}  // namespace
}  // namespace anigen::raster
