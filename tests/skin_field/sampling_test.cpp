#include "anigen/skin_field/sampling.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/geometry/nearest_surface.h"

namespace anigen::skin_field {
namespace {

using torch::Tensor;

struct MixMesh {
  Tensor vertices, faces;

  geometry::NearestSurface surface() const {
    std::vector<Eigen::Vector3f> points;
    std::vector<Triangle> triangles;
    for (std::int64_t v = 0; v < vertices.size(0); ++v) {
      const float* p = vertices.data_ptr<float>() + 3 * v;
      points.emplace_back(p[0], p[1], p[2]);
    }
    for (std::int64_t f = 0; f < faces.size(0); ++f) {
      const std::int64_t* t = faces.data_ptr<std::int64_t>() + 3 * f;
      triangles.push_back(
          {static_cast<std::int32_t>(t[0]), static_cast<std::int32_t>(t[1]), static_cast<std::int32_t>(t[2])});
    }
    return geometry::NearestSurface(points, triangles);
  }
};

TEST(VertexMix, InterpolatesOnTheNearestTriangle) {
  const MixMesh mesh{torch::tensor({0.0F, 0.0F, 0.0F, 1.0F, 0.0F, 0.0F, 0.0F, 1.0F, 0.0F}).view({3, 3}),
                     torch::tensor({0, 1, 2}, torch::kInt64).view({1, 3})};
  const Tensor points = torch::tensor({0.25F, 0.5F, 0.3F, -1.0F, -1.0F, 0.0F}).view({2, 3});
  const VertexMix mix = nearest_surface_mix(mesh.surface(), mesh.vertices, mesh.faces, points);
  ASSERT_EQ(mix.points(), 2);
  // A feature that is linear in space takes its value at the nearest place.
  const Tensor found = mixed(mesh.vertices, mix);
  EXPECT_TRUE(torch::allclose(found, torch::tensor({0.25F, 0.5F, 0.0F, 0.0F, 0.0F, 0.0F}).view({2, 3}), 1e-6, 1e-6));
}

TEST(VertexMix, TrianglesWithoutAreaInterpolateAlongTheLongestEdge) {
  // The corner in the middle stands 1e-7 off the edge: 4 · area² = 1e-14.
  const MixMesh mesh{torch::tensor({0.0F, 0.0F, 0.0F, 0.4F, 1e-7F, 0.0F, 1.0F, 0.0F, 0.0F}).view({3, 3}),
                     torch::tensor({0, 1, 2}, torch::kInt64).view({1, 3})};
  const Tensor points = torch::tensor({0.4F, 1.0F, 0.0F}).view({1, 3});
  const VertexMix mix = nearest_surface_mix(mesh.surface(), mesh.vertices, mesh.faces, points);
  const Tensor on_vertices = mixed(torch::eye(3), mix);
  EXPECT_TRUE(torch::allclose(on_vertices, torch::tensor({0.6F, 0.0F, 0.4F}).view({1, 3}), 1e-5, 1e-6));
}

TEST(VertexMix, WeightsAreClampedAndNormalised) {
  const Tensor faces = torch::tensor({4, 1, 2}).view({1, 3});
  const Tensor face = torch::zeros({3}, torch::kInt64);
  const Tensor weights = torch::tensor({-0.5F, 0.5F, 1.0F, 0.0F, 0.0F, 0.0F, 0.0F, 5e-4F, 0.0F}).view({3, 3});
  const VertexMix encoder = surface_mix(face, weights, faces),
                  loss = surface_mix(face, weights, faces, kLossLeastWeight);
  EXPECT_TRUE(torch::equal(encoder.vertices[0], torch::tensor({4, 1, 2}, torch::kInt64)));
  EXPECT_TRUE(torch::allclose(encoder.weights[0], torch::tensor({0.0F, 1.0F / 3, 2.0F / 3})));
  EXPECT_EQ(encoder.weights[1].abs().sum().item<double>(), 0.0);
  EXPECT_NEAR(encoder.weights[2].sum().item<double>(), 1.0, 1e-6);
  EXPECT_NEAR(loss.weights[2].sum().item<double>(), 0.5, 1e-6);
}

TEST(VertexMix, NearestVertex) {
  const Tensor vertices = torch::tensor({0.0F, 0.0F, 0.0F, 1.0F, 0.0F, 0.0F}).view({2, 3});
  const Tensor points = torch::tensor({0.4F, 0.0F, 0.0F, 0.5F, 0.0F, 0.0F, 0.6F, 3.0F, 0.0F}).view({3, 3});
  const Tensor found = mixed(torch::tensor({10.0F, 20.0F}).view({2, 1}), nearest_vertex_mix(vertices, points));
  EXPECT_TRUE(torch::equal(found, torch::tensor({10.0F, 10.0F, 20.0F}).view({3, 1})));
}

TEST(VertexMix, GradientsReachTheFeatures) {
  Tensor features = torch::zeros({3, 2}).requires_grad_();
  const VertexMix mix{torch::tensor({0, 1, 1, 2, 2, 0}, torch::kInt64).view({2, 3}),
                      torch::tensor({0.5F, 0.25F, 0.25F, 1.0F, 2.0F, 3.0F}).view({2, 3})};
  mixed(features, mix).sum().backward();
  EXPECT_TRUE(torch::allclose(features.grad().select(1, 0), torch::tensor({3.5F, 0.5F, 3.0F})));
}

TEST(VertexMix, RefusesWhatDoesNotFit) {
  const Tensor faces = torch::tensor({0, 1, 2}).view({1, 3}), weights = torch::ones({1, 3});
  EXPECT_THROW(surface_mix(torch::tensor({1}), weights, faces), InputError);
  EXPECT_THROW(surface_mix(torch::tensor({-1}), weights, faces), InputError);
  EXPECT_THROW(surface_mix(torch::tensor({0, 0}), weights, faces), InputError);
  EXPECT_THROW(surface_mix(torch::tensor({0}), weights, weights), InputError);
  EXPECT_THROW(nearest_vertex_mix(torch::ones({2, 2}), torch::ones({1, 3})), InputError);
  EXPECT_THROW(nearest_vertex_mix(torch::full({2, 3}, NAN), torch::ones({1, 3})), InputError);
  EXPECT_THROW(mixed(torch::ones({2, 1}), surface_mix(torch::tensor({0}), weights, faces)), InputError);
}

}  // namespace
}  // namespace anigen::skin_field
