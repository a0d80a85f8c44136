#include "anigen/raster/antialias.h"

#include <ATen/Parallel.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "anigen/core/error.h"
#include "tests/raster/raster_meshes.h"

namespace anigen::raster {
namespace {

// Silhouettes of one colour on black, [H, W].
Tensor antialiased_mask(const Tensor& clip, const Tensor& faces, std::int64_t height, std::int64_t width,
                        std::int64_t bits) {
  const Fragments fragments = rasterize(clip, faces, height, width, bits);
  return antialias((fragments.triangle > 0).to(clip.scalar_type()).unsqueeze(2), fragments, clip, faces).squeeze(2);
}

// Two triangles; beyond the picture above and below, so that only the left and right edges show.
ClipMesh upright_strip(double left, double right) {
  return {clip_points({left, -2, 0, 1, right, -2, 0, 1, right, 2, 0, 1, left, 2, 0, 1}),
          torch::tensor({0, 1, 2, 0, 2, 3}, torch::kInt64).view({2, 3})};
}

TEST(Antialias, StraightEdgeGivesTheCoveredShare) {
  // From pixel 3.0 to 8.3 of 16.
  const ClipMesh mesh = upright_strip(2.0 * 3.0 / 16.0 - 1.0, 2.0 * 8.3 / 16.0 - 1.0);
  const Tensor mask = antialiased_mask(mesh.clip, mesh.faces, 5, 16, 4);
  Tensor wanted = torch::zeros({5, 16}, torch::kFloat64);
  wanted.narrow(1, 3, 5).fill_(1.0);
  wanted.select(1, 8).fill_(0.3);
  EXPECT_LT((mask - wanted).abs().max().item<double>(), 1e-12);
  // Turned by a quarter: rows instead of columns.
  const Tensor turned =
      torch::cat({mesh.clip.narrow(1, 1, 1), mesh.clip.narrow(1, 0, 1), mesh.clip.narrow(1, 2, 2)}, 1);
  EXPECT_LT((antialiased_mask(turned, mesh.faces, 16, 5, 4) - wanted.t()).abs().max().item<double>(), 1e-12);
}

TEST(Antialias, MovingAnEdgeMovesTheCoveredAreaByItsLength) {
  const ClipMesh mesh = upright_strip(-0.5, 2.0 * 8.3 / 16.0 - 1.0);
  const Tensor clip = mesh.clip.clone().requires_grad_();
  antialiased_mask(clip, mesh.faces, 5, 16, 4).sum().backward();
  // Both ends of the right edge together: 5 rows, 8 pixels per unit of x/w.
  const double by_x = clip.grad().narrow(0, 1, 2).select(1, 0).sum().item<double>();
  EXPECT_NEAR(by_x, 5.0 * 8.0, 1e-9);
  EXPECT_EQ(clip.grad().select(1, 2).abs().max().item<double>(), 0.0);
}

TEST(Antialias, AreaOfAGrowingTriangle) {
  const Tensor corners = clip_points({-0.61, -0.52, 0, 1, 0.73, -0.31, 0, 1, -0.12, 0.77, 0, 1});
  constexpr std::int64_t kSize = 96;
  const Tensor at = corners.narrow(1, 0, 2) * (kSize / 2.0);
  const Tensor b = at[1] - at[0], c = at[2] - at[0];
  const double area = 0.5 * (b[0] * c[1] - b[1] * c[0]).item<double>();
  const Tensor clip = corners.clone().requires_grad_();
  const Tensor mask = antialiased_mask(clip, separate_faces(1), kSize, kSize, 12);
  // Along an edge the error of a pixel's share has either sign; only the corners are not resolved, to about a pixel.
  EXPECT_NEAR(mask.sum().item<double>(), area, 3.0);
  mask.sum().backward();
  const Tensor gradient = clip.grad().narrow(1, 0, 2);
  // d area / d scale = 2 area; moving it whole changes nothing.
  EXPECT_NEAR((gradient * corners.narrow(1, 0, 2)).sum().item<double>(), 2.0 * area, 0.01 * 2.0 * area);
  EXPECT_LT(gradient.sum(0).abs().max().item<double>(), 0.01 * gradient.abs().sum().item<double>());
  // Each corner sees its share of two edges: the exact gradient of the shoelace formula, in pixels² per unit of x/w.
  for (std::int64_t k = 0; k < 3; ++k) {
    const Tensor across = at[(k + 2) % 3] - at[(k + 1) % 3];  // turned by a quarter: d area / d corner
    EXPECT_NEAR(gradient[k][0].item<double>(), -0.5 * across[1].item<double>() * kSize / 2.0, 0.02 * area);
    EXPECT_NEAR(gradient[k][1].item<double>(), 0.5 * across[0].item<double>() * kSize / 2.0, 0.02 * area);
  }
}

TEST(Antialias, GradientMatchesFiniteDifferences) {
  torch::manual_seed(4);
  constexpr std::int64_t kHeight = 48, kWidth = 60;
  // Two overlapping sheets in perspective, so that edges cross surfaces too.
  const Tensor clip =
      clip_points({-0.8, -0.7,  0.2,  1.0, 0.9,  -0.6, 0.3,  1.2, 0.8,  1.1, 0.1,  1.5, -0.9, 0.6, 0.2, 1.1,  //
                   -0.3, -0.35, -0.4, 0.9, 0.45, -0.2, -0.3, 1.0, 0.25, 0.6, -0.2, 1.3});
  const Tensor faces = torch::tensor({0, 1, 2, 0, 2, 3, 4, 5, 6}, torch::kInt64).view({3, 3});
  const Tensor image = torch::randn({kHeight, kWidth, 2}, torch::kFloat64);
  const Tensor weights = torch::randn({kHeight, kWidth, 2}, torch::kFloat64);
  const Fragments fragments = rasterize(clip, faces, kHeight, kWidth, 12);
  const Tensor positions = clip.clone().requires_grad_(), colors = image.clone().requires_grad_();
  const auto gradients =
      torch::autograd::grad({(antialias(colors, fragments, positions, faces) * weights).sum()}, {positions, colors});

  const auto loss = [&](const Tensor& moved_clip, const Tensor& moved_image) {
    const Fragments seen = rasterize(moved_clip, faces, kHeight, kWidth, 12);
    EXPECT_TRUE(torch::equal(seen.triangle, fragments.triangle));
    return (antialias(moved_image, seen, moved_clip, faces) * weights).sum().item<double>();
  };
  const double h = 1e-7;
  for (std::int64_t axis = 0; axis < 4; ++axis) {
    const Tensor direction = torch::zeros_like(clip);
    direction.select(1, axis).copy_(torch::randn({clip.size(0)}, torch::kFloat64));
    const double slope = (loss(clip + h * direction, image) - loss(clip - h * direction, image)) / (2.0 * h);
    // The backward pass adds 1e-3 pixel to the height of an edge, of some ten pixels and more.
    const double size = (gradients[0] * direction).abs().sum().item<double>();
    EXPECT_NEAR((gradients[0] * direction).sum().item<double>(), slope, 1e-3 * size + 1e-5) << "axis " << axis;
  }
  const Tensor direction = torch::randn_like(image);
  const double slope = (loss(clip, image + direction) - loss(clip, image - direction)) / 2.0;  // linear in the image
  EXPECT_NEAR((gradients[1] * direction).sum().item<double>(), slope, 1e-9 * (1.0 + std::abs(slope)));
}

TEST(Antialias, OnlySilhouettesBlend) {
  // A flat square of many triangles: nothing inside it may blend, whatever its colours.
  torch::manual_seed(9);
  const ClipMesh mesh = clip_grid(6, 6, 1.5);
  const Fragments fragments = rasterize(mesh.clip, mesh.faces, 32, 32);
  const Tensor image = torch::randn({32, 32, 3});
  EXPECT_TRUE(torch::equal(antialias(image, fragments, mesh.clip, mesh.faces), image));
  // A fold: the same triangle opened to the other side of the shared edge, and folded back onto its neighbour.
  const Tensor faces = torch::tensor({0, 1, 2, 1, 0, 3}, torch::kInt64).view({2, 3});
  const Tensor open = clip_points({0.03, -2, 0, 1, 0.03, 2, 0, 1, -3, 0, 0, 1, 3, 0, 0, 1});
  Tensor folded = open.clone();
  folded[3][0].fill_(-1.5);
  const auto pairs = [&](const Tensor& clip) {
    return find_silhouette_pairs(rasterize(clip, faces, 16, 16), clip, faces).index.size(0);
  };
  EXPECT_EQ(pairs(open), 0);
  EXPECT_GE(pairs(folded), 16);
}

TEST(Antialias, NearerTriangleOwnsTheEdge) {
  // A near strip over a far picture-filling one: the far one's colour shines through at the near one's edge.
  const ClipMesh near = upright_strip(-0.5, 2.0 * 8.3 / 16.0 - 1.0), far = upright_strip(-2.0, 2.0);
  Tensor behind = far.clip.clone();
  behind.select(1, 2).fill_(0.5);
  const Tensor clip = torch::cat({near.clip, behind}, 0), faces = torch::cat({near.faces, far.faces + 4}, 0);
  const Fragments fragments = rasterize(clip, faces, 3, 16);
  const Tensor image = torch::where(fragments.triangle <= 2, 10.0, 20.0).to(torch::kFloat64).unsqueeze(2);
  const Tensor out = antialias(image, fragments, clip, faces);
  EXPECT_NEAR(out[1][8][0].item<double>(), 0.3 * 10.0 + 0.7 * 20.0, 1e-9);
  EXPECT_NEAR(out[1][7][0].item<double>(), 10.0, 1e-12);
}

TEST(Antialias, TheSameBitsForAnyNumberOfThreads) {
  torch::manual_seed(12);
  const int before = at::get_num_threads();
  const ClipMesh soup = triangle_soup(60, true);
  const Tensor image = torch::randn({50, 40, 3}), direction = torch::randn({50, 40, 3});
  std::vector<Tensor> first;
  for (const int threads : {1, 2, 3}) {
    at::set_num_threads(threads);
    const Tensor clip = soup.clip.to(torch::kFloat32).requires_grad_(), colors = image.clone().requires_grad_();
    const Tensor out = antialias(colors, rasterize(clip, soup.faces, 50, 40), clip, soup.faces);
    const auto gradients = torch::autograd::grad({out}, {clip, colors}, {direction});
    const std::vector<Tensor> all{out.detach(), gradients[0], gradients[1]};
    for (const Tensor& tensor : all) EXPECT_TRUE(tensor.isfinite().all().item<bool>());
    if (first.empty()) first = all;
    for (std::size_t i = 0; i < all.size(); ++i) EXPECT_TRUE(torch::equal(all[i], first[i])) << threads << ", " << i;
  }
  at::set_num_threads(before);
}

TEST(Antialias, SmallAndEmptyPictures) {
  const ClipMesh mesh = upright_strip(-0.5, 0.5);
  const Fragments one = rasterize(mesh.clip, mesh.faces, 1, 1);
  EXPECT_EQ(antialias(torch::ones({1, 1, 2}), one, mesh.clip, mesh.faces).sum().item<float>(), 2.0f);
  const Tensor nothing = torch::zeros({0, 4}), no_faces = torch::zeros({0, 3}, torch::kInt64);
  const Tensor image = torch::randn({4, 3, 1});
  EXPECT_TRUE(torch::equal(antialias(image, rasterize(nothing, no_faces, 4, 3), nothing, no_faces), image));
}

TEST(Antialias, BadInputIsRefused) {
  const ClipMesh mesh = upright_strip(-0.5, 0.5);
  const Fragments fragments = rasterize(mesh.clip, mesh.faces, 4, 6);
  const Tensor image = torch::zeros({4, 6, 1});
  EXPECT_THROW(antialias(image.squeeze(2), fragments, mesh.clip, mesh.faces), InputError);
  EXPECT_THROW(antialias(torch::zeros({4, 5, 1}), fragments, mesh.clip, mesh.faces), InputError);
  EXPECT_THROW(antialias(image.to(torch::kInt64), fragments, mesh.clip, mesh.faces), InputError);
  EXPECT_THROW(antialias(image, fragments, mesh.clip, mesh.faces.narrow(0, 0, 1)), InputError);  // too few faces
  Fragments broken = fragments;
  broken.depth = fragments.depth.narrow(0, 0, 3);
  EXPECT_THROW(antialias(image, broken, mesh.clip, mesh.faces), InputError);
}

TEST(EdgeNeighbours, FindsAllOthersAtAnEdge) {
  // A fan of 50 around vertex 0 (more sides than are looked through one by one), one triangle of it twice, and one
  // with a repeated vertex.
  std::vector<std::int64_t> faces;
  for (std::int64_t i = 0; i < 50; ++i) faces.insert(faces.end(), {0, 51 - i, 50 - i});
  faces.insert(faces.end(), {0, 31, 30, 7, 7, 60});
  const EdgeNeighbours neighbours(faces.data(), 52, 61);
  const auto others = [&](std::int64_t a, std::int64_t b, std::int64_t own) {
    std::vector<std::int64_t> found;
    neighbours.visit_others(a, b, own, [&](std::int64_t vertex) { found.push_back(vertex); });
    std::sort(found.begin(), found.end());
    return found;
  };
  using Vertices = std::vector<std::int64_t>;
  EXPECT_EQ(others(0, 20, 31), (Vertices{21}));  // face 31 is 0, 20, 19
  EXPECT_EQ(others(20, 0, 30), (Vertices{19}));
  EXPECT_EQ(others(0, 51, 0), Vertices{});       // an end of the fan
  EXPECT_EQ(others(30, 31, 20), (Vertices{0}));  // the twin of face 20
  EXPECT_EQ(others(0, 31, 20), (Vertices{30, 32}));
  EXPECT_EQ(others(5, 40, 0), Vertices{});
  EXPECT_EQ(others(60, 7, 51), (Vertices{}));
}

}  // namespace
}  // namespace anigen::raster
