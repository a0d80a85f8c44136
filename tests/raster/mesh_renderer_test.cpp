#include "anigen/raster/mesh_renderer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "anigen/core/error.h"
#include "tests/raster/raster_meshes.h"

namespace anigen::raster {
namespace {

struct View {
  Tensor extrinsics, intrinsics;
};

// World and camera axes agree; the camera stands two in front of the origin.
View front_view(torch::Dtype dtype) {
  const Tensor extrinsics = torch::eye(4, dtype), intrinsics = torch::eye(3, dtype);
  extrinsics[2][3].fill_(2.0);
  intrinsics[0][2].fill_(0.5);
  intrinsics[1][2].fill_(0.5);
  return {extrinsics, intrinsics};
}

// A square of side 1 at z = 0 of the world, whose normal is −z, towards the camera.
ClipMesh square() {
  return {torch::tensor({-0.5, -0.5, 0.0, 0.5, -0.5, 0.0, 0.5, 0.5, 0.0, -0.5, 0.5, 0.0}, torch::kFloat64).view({4, 3}),
          torch::tensor({0, 2, 1, 0, 3, 2}, torch::kInt64).view({2, 3})};
}

Rendering render(const Tensor& vertices, const Tensor& attributes, const RenderOptions& options) {
  const View view = front_view(vertices.scalar_type());
  return render_mesh(vertices, square().faces, attributes, view.extrinsics, view.intrinsics, options);
}

RenderOptions small(std::int64_t resolution = 32) {
  RenderOptions options;
  options.resolution = resolution;
  return options;
}

TEST(MeshRenderer, ShowsASquareWhereTheCameraSeesIt) {
  // fx = 1 and depth 2: x from -0.5 to 0.5 shows at u from 0.25 to 0.75, pixels 8 to 24 of 32.
  const Tensor attributes = square().clip.narrow(1, 1, 1).contiguous();  // y of the world
  const Rendering found = render(square().clip, attributes, small());
  Tensor wanted = torch::zeros({32, 32}, torch::kFloat64);
  wanted.narrow(0, 8, 16).narrow(1, 8, 16).fill_(1.0);
  EXPECT_LT((found.mask - wanted).abs().max().item<double>(), 1e-12);
  EXPECT_LT((found.depth - 2.0 * wanted).abs().max().item<double>(), 1e-12);
  const Tensor normal =
      torch::stack({0.5 * torch::ones_like(wanted), 0.5 * torch::ones_like(wanted), 0.5 - 0.5 * wanted}, 2);
  EXPECT_LT((found.normal - normal).abs().max().item<double>(), 1e-12);
  // Row 0 is the top: y of OpenCV points down, so it grows with the row.
  EXPECT_NEAR(found.attributes[8][16][0].item<double>(), -0.5 + 0.5 / 16.0, 1e-12);
  EXPECT_NEAR(found.attributes[23][16][0].item<double>(), 0.5 - 0.5 / 16.0, 1e-12);
  EXPECT_EQ(found.attributes.size(2), 1);
}

TEST(MeshRenderer, SupersamplingKeepsSizeAndInterior) {
  RenderOptions options = small();
  options.ssaa = 3;
  const Rendering found = render(square().clip, Tensor(), options), plain = render(square().clip, Tensor(), small());
  EXPECT_FALSE(found.attributes.defined());
  EXPECT_EQ(found.mask.sizes(), plain.mask.sizes());
  EXPECT_EQ(found.normal.sizes(), plain.normal.sizes());
  const auto inside = [](const Tensor& image) { return image.narrow(0, 10, 12).narrow(1, 10, 12); };
  EXPECT_LT((inside(found.depth) - 2.0).abs().max().item<double>(), 1e-12);
  EXPECT_LT((inside(found.normal) - inside(plain.normal)).abs().max().item<double>(), 1e-12);
  EXPECT_NEAR(found.mask.sum().item<double>(), plain.mask.sum().item<double>(), 1e-9);
  EXPECT_NEAR(found.normal[0][0][2].item<double>(), 0.5, 1e-12);
}

TEST(MeshRenderer, GradientsOfEveryPictureReachTheVertices) {
  const Tensor vertices = (square().clip + 0.013).requires_grad_();
  const Tensor attributes = torch::rand({4, 3}, torch::kFloat64).requires_grad_();
  const Rendering found = render(vertices, attributes, small());
  for (const Tensor& image : {found.mask, found.depth, found.normal, found.attributes}) {
    const Tensor gradient = torch::autograd::grad({image.square().sum()}, {vertices}, {}, /*retain_graph=*/true)[0];
    EXPECT_TRUE(gradient.isfinite().all().item<bool>());
    EXPECT_GT(gradient.abs().max().item<double>(), 1e-3);
  }
  const Tensor gradient = torch::autograd::grad({found.attributes.sum()}, {attributes})[0];
  // Every covered pixel hands out a weight of one, and antialiasing keeps what it takes from it.
  EXPECT_NEAR(gradient.sum().item<double>(), 3.0 * found.mask.sum().item<double>(), 1e-6);
}

TEST(MeshRenderer, ApproachingTheSquareIsSeenInDepth) {
  const Tensor vertices = square().clip.clone().requires_grad_();
  const Rendering found = render(vertices, Tensor(), small());
  found.depth.narrow(0, 12, 8).narrow(1, 12, 8).sum().backward();
  EXPECT_NEAR(vertices.grad().select(1, 2).sum().item<double>(), 64.0, 1e-9);
}

TEST(MeshRenderer, EmptyMeshAndOnePixel) {
  const View view = front_view(torch::kFloat32);
  const Tensor vertices = torch::zeros({0, 3}).requires_grad_();
  const Rendering nothing = render_mesh(vertices, torch::zeros({0, 3}, torch::kInt64), torch::zeros({0, 6}),
                                        view.extrinsics, view.intrinsics, small(7));
  EXPECT_EQ(nothing.mask.abs().sum().item<float>(), 0.0f);
  EXPECT_EQ(nothing.depth.abs().sum().item<float>(), 0.0f);
  EXPECT_TRUE((nothing.normal == 0.5).all().item<bool>());
  EXPECT_EQ(nothing.attributes.size(2), 6);
  nothing.mask.sum().backward();
  EXPECT_EQ(vertices.grad().size(0), 0);
  EXPECT_NEAR(render(square().clip, Tensor(), small(1)).depth.item<double>(), 2.0, 1e-12);
}

TEST(MeshRenderer, SurfaceBeforeTheNearPlaneShowsFromTheClipPlaneOn) {
  // z/w = -1 at near·far / (2 far − near) = 0.6.
  for (const double depth : {0.59, 0.61}) {
    const Tensor vertices = square().clip.clone();
    vertices.select(1, 2).fill_(depth - 2.0);
    const double shown = render(vertices, Tensor(), small()).mask.sum().item<double>();
    EXPECT_EQ(shown > 0.0, depth > 0.6) << depth;
  }
}

TEST(MeshRenderer, BadInputIsRefused) {
  const View view = front_view(torch::kFloat64);
  const ClipMesh mesh = square();
  const auto with = [&](const Tensor& vertices, const Tensor& attributes, const RenderOptions& options) {
    render_mesh(vertices, mesh.faces, attributes, view.extrinsics, view.intrinsics, options);
  };
  RenderOptions options = small();
  for (const std::int64_t resolution : {std::int64_t{0}, std::int64_t{-3}, std::int64_t{1} << 50}) {
    options.resolution = resolution;
    EXPECT_THROW(with(mesh.clip, Tensor(), options), InputError) << resolution;
  }
  for (const std::int64_t ssaa : {std::int64_t{0}, std::int64_t{1} << 40}) {
    options = small();
    options.ssaa = ssaa;
    EXPECT_THROW(with(mesh.clip, Tensor(), options), InputError) << ssaa;
  }
  options = small();
  options.far = options.near;
  EXPECT_THROW(with(mesh.clip, Tensor(), options), InputError);
  EXPECT_THROW(with(mesh.clip, torch::zeros({3, 2}, torch::kFloat64), small()), InputError);
  EXPECT_THROW(with(mesh.clip, torch::zeros({4, 2}, torch::kFloat32), small()), InputError);
  EXPECT_THROW(with(mesh.clip.to(torch::kFloat32), Tensor(), small()), InputError);  // the camera is fp64
  EXPECT_THROW(with(mesh.clip.narrow(1, 0, 2), Tensor(), small()), InputError);
  Tensor broken = mesh.clip.clone();
  broken[3][1].fill_(std::numeric_limits<double>::quiet_NaN());
  EXPECT_THROW(with(broken, Tensor(), small()), InputError);
}

TEST(Camera, ProjectionHasThePublishedEntries) {
  const Tensor intrinsics = torch::eye(3, torch::kFloat64);
  intrinsics[0][0].fill_(1.3);
  intrinsics[1][1].fill_(1.1);
  intrinsics[0][2].fill_(0.4);
  intrinsics[1][2].fill_(0.7);
  const Tensor wanted =
      torch::tensor({2.6, 0.0, -0.2, 0.0, 0.0, 2.2, -0.4, 0.0, 0.0, 0.0, 1.5, -1.5, 0.0, 0.0, 1.0, 0.0},
                    torch::kFloat64)
          .view({4, 4});
  EXPECT_LT((projection_matrix(intrinsics, 1.0, 3.0) - wanted).abs().max().item<double>(), 1e-15);
  EXPECT_THROW(projection_matrix(intrinsics, 0.0, 3.0), InputError);
  EXPECT_THROW(projection_matrix(torch::eye(4), 1.0, 3.0), InputError);
  EXPECT_THROW(to_clip(torch::zeros({2, 3}), torch::eye(3), torch::eye(4)), InputError);
}

}  // namespace
}  // namespace anigen::raster
