// The hand-written backward passes of rasterisation, interpolation and face normals against central differences.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "anigen/core/error.h"
#include "anigen/raster/interpolate.h"
#include "anigen/raster/rasterize.h"
#include "tests/raster/raster_meshes.h"

namespace anigen::raster {
namespace {

constexpr double kStep = 1e-6;  // error of a central difference ~ h² third derivative, of rounding ~ 1e-13 / h

double central_difference(const std::function<double(const Tensor&)>& loss, const Tensor& at, const Tensor& direction) {
  return (loss(at + kStep * direction) - loss(at - kStep * direction)) / (2.0 * kStep);
}

// A bumpy sheet with perspective, shared vertices, part of it in front of the rest.
ClipMesh sheet() {
  torch::manual_seed(21);
  ClipMesh mesh = clip_grid(4, 3, 0.9);
  mesh.clip.narrow(1, 0, 3).add_(0.2 * torch::rand({mesh.clip.size(0), 3}, torch::kFloat64));
  mesh.clip.mul_(1.0 + torch::rand({mesh.clip.size(0), 1}, torch::kFloat64));
  const Tensor nearer = clip_points({-0.5, -0.4, -0.6, 1.2, 0.7, -0.1, -0.5, 1.5, 0.1, 0.9, -0.7, 1.1});
  const std::int64_t vertices = mesh.clip.size(0);
  return {torch::cat({mesh.clip, nearer}, 0), torch::cat({mesh.faces, separate_faces(1) + vertices}, 0)};
}

TEST(RasterGradient, OfInterpolationMatchesFiniteDifferences) {
  const ClipMesh mesh = sheet();
  constexpr std::int64_t kHeight = 33, kWidth = 41;
  const Tensor attributes = torch::randn({mesh.clip.size(0), 3}, torch::kFloat64).requires_grad_();
  const Tensor clip = mesh.clip.clone().requires_grad_();
  const Fragments fragments = rasterize(clip, mesh.faces, kHeight, kWidth, 12);
  // Only pixels that are not clamped: there the gradient deliberately ignores the clamp.
  const Tensor uv = fragments.barycentric.detach(), rest = 1.0 - uv.sum(-1, /*keepdim=*/true);
  const Tensor inner = torch::cat({uv, rest}, 2).amin(-1, /*keepdim=*/true) > 1e-3;
  const Tensor weights = torch::randn({kHeight, kWidth, 3}, torch::kFloat64) * inner;
  const auto gradients =
      torch::autograd::grad({(interpolate(attributes, fragments, mesh.faces) * weights).sum()}, {clip, attributes});
  EXPECT_EQ(gradients[0].select(1, 2).abs().max().item<double>(), 0.0);  // never through z

  const torch::NoGradGuard no_grad;
  const auto loss_at = [&](const Tensor& positions) {
    const Fragments moved = rasterize(positions, mesh.faces, kHeight, kWidth, 12);
    EXPECT_TRUE(torch::equal(moved.triangle, fragments.triangle));  // else the difference would see a jump
    return (interpolate(attributes, moved, mesh.faces) * weights).sum().item<double>();
  };
  const auto loss_with = [&](const Tensor& table) {
    return (interpolate(table, fragments, mesh.faces) * weights).sum().item<double>();
  };
  for (int trial = 0; trial < 4; ++trial) {
    Tensor direction = torch::randn_like(mesh.clip);
    if (trial > 0) {  // x, y and w alone
      const std::int64_t axis = trial == 3 ? 3 : trial - 1;
      const Tensor only = torch::zeros_like(direction);
      only.select(1, axis).copy_(direction.select(1, axis));
      direction = only;
    }
    const double slope = central_difference(loss_at, mesh.clip, direction);
    EXPECT_NEAR((gradients[0] * direction).sum().item<double>(), slope, 1e-6 * (1.0 + std::abs(slope))) << trial;
  }
  const Tensor direction = torch::randn_like(attributes);
  const double slope = central_difference(loss_with, attributes.detach(), direction);
  EXPECT_NEAR((gradients[1] * direction).sum().item<double>(), slope, 1e-6 * (1.0 + std::abs(slope)));
}

TEST(RasterGradient, OfFaceNormalsMatchesFiniteDifferences) {
  const ClipMesh mesh = sheet();
  const Tensor vertices = mesh.clip.narrow(1, 0, 3).clone().requires_grad_();
  const Tensor weights = torch::randn({mesh.faces.size(0), 3}, torch::kFloat64);
  const auto loss = [&](const Tensor& at) { return (face_normals(at, mesh.faces) * weights).sum(); };
  const Tensor gradient = torch::autograd::grad({loss(vertices)}, {vertices})[0];
  const Tensor direction = torch::randn_like(vertices);
  const double slope =
      central_difference([&](const Tensor& at) { return loss(at).item<double>(); }, vertices.detach(), direction);
  EXPECT_NEAR((gradient * direction).sum().item<double>(), slope, 1e-6 * (1.0 + std::abs(slope)));
}

TEST(FaceNormals, FollowTheWindingAndStandDegenerateFaces) {
  const Tensor vertices =
      torch::tensor({0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 3.0, 0.0}, torch::kFloat64).view({3, 3}).requires_grad_();
  const Tensor faces = torch::tensor({0, 1, 2, 0, 2, 1, 1, 1, 2}, torch::kInt64).view({3, 3});
  const Tensor normals = face_normals(vertices, faces);
  const Tensor wanted = torch::tensor({0.0, 0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0}, torch::kFloat64).view({3, 3});
  EXPECT_TRUE(torch::equal(normals.detach(), wanted));
  normals.select(0, 2).sum().backward();
  EXPECT_EQ(vertices.grad().abs().max().item<double>(), 0.0);
  EXPECT_THROW(face_normals(vertices.narrow(1, 0, 2), faces), InputError);
  EXPECT_THROW(face_normals(vertices, faces + 1), InputError);
}

TEST(Interpolate, IndexListOfItsOwn) {
  // Three private corners per face, as flat attributes use them.
  const ClipMesh mesh = clip_grid(1, 1, 1.0);
  const Fragments fragments = rasterize(mesh.clip, mesh.faces, 8, 8);
  const Tensor flat = torch::tensor({5.0, 5.0, 5.0, 7.0, 7.0, 7.0}, torch::kFloat64).unsqueeze(1);
  const Tensor image = interpolate(flat, fragments, separate_faces(2)).squeeze(2);
  EXPECT_LT((image - (2.0 * fragments.triangle.to(torch::kFloat64) + 3.0)).abs().max().item<double>(), 1e-12);
}

TEST(Interpolate, BadInputIsRefused) {
  const ClipMesh mesh = clip_grid(1, 1, 1.0);
  const Fragments fragments = rasterize(mesh.clip, mesh.faces, 8, 8);
  const Tensor attributes = torch::zeros({4, 2}, torch::kFloat64);
  EXPECT_THROW(interpolate(attributes.narrow(0, 0, 3), fragments, mesh.faces), InputError);
  EXPECT_THROW(interpolate(attributes, fragments, mesh.faces.narrow(0, 0, 1)), InputError);  // too few faces
  EXPECT_THROW(interpolate(attributes.select(1, 0), fragments, mesh.faces), InputError);
  EXPECT_THROW(interpolate(attributes.to(torch::kInt64), fragments, mesh.faces), InputError);
  Fragments broken = fragments;
  broken.barycentric = fragments.barycentric.narrow(0, 0, 7);
  EXPECT_THROW(interpolate(attributes, broken, mesh.faces), InputError);
}

TEST(Interpolate, SecondDerivativesAreAnErrorAndNotWrong) {
  const ClipMesh mesh = clip_grid(1, 1, 1.0);
  const Tensor clip = mesh.clip.clone().requires_grad_();
  const Tensor image = interpolate(clip, rasterize(clip, mesh.faces, 8, 8), mesh.faces);
  EXPECT_THROW(torch::autograd::grad({image.square().sum()}, {clip}, {}, /*retain_graph=*/true, /*create_graph=*/true),
               c10::Error);
}

}  // namespace
}  // namespace anigen::raster
