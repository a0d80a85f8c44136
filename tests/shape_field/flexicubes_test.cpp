#include <ATen/Parallel.h>
#include <gtest/gtest.h>
#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "anigen/core/hash.h"
#include "anigen/shape_field/dual_vertices.h"
#include "anigen/shape_field/flexicubes.h"
#include "benchmarks/plain_flexicubes.h"
#include "tests/shape_field/implicit_shapes.h"
#include "tests/shape_field/mesh_checks.h"

namespace anigen::shape_field {

namespace {

using test::Implicit;
using test::Place;

constexpr double kPi = 3.14159265358979323846;

ExtractedSurface surface_of(const Implicit& distance, std::int64_t resolution, bool training = false) {
  return flexicubes(average_corners(test::corners_of(distance, resolution), resolution), training);
}

// Mean distance of the vertices from the surface they stand for.
double mean_distance(const ExtractedSurface& surface, const Implicit& distance) {
  const double* p = surface.vertices.data_ptr<double>();
  double sum = 0.0;
  for (std::int64_t v = 0; v < surface.vertices.size(0); ++v) {
    sum += std::abs(distance({p[3 * v], p[3 * v + 1], p[3 * v + 2]}));
  }
  return sum / static_cast<double>(surface.vertices.size(0));
}

class FlexicubesShapes : public testing::TestWithParam<test::ImplicitShape> {};

// Every edge has two faces of opposite direction, also where thin walls and saddles need several vertices per cube.
TEST_P(FlexicubesShapes, AreClosedAndFaceOutside) {
  for (const bool training : {false, true}) {
    const ExtractedSurface surface = surface_of(GetParam().distance, 32, training);
    ASSERT_GT(surface.faces.size(0), 100);
    EXPECT_EQ(test::unmatched_edges(surface.faces), 0);
    EXPECT_GT(test::enclosed_volume(surface.vertices, surface.faces), 0.0);
  }
}

// Chamfer distances of dual surfaces fall with the square of the cell; sharp features and flat faces with less. At 32
// cells it is a few hundredths of a cell.
TEST_P(FlexicubesShapes, ComeNearerWithResolution) {
  const double coarse = mean_distance(surface_of(GetParam().distance, 16), GetParam().distance);
  const double fine = mean_distance(surface_of(GetParam().distance, 32), GetParam().distance);
  EXPECT_LT(fine, 0.55 * coarse);
  EXPECT_LT(fine, 0.1 / 32.0);
}

INSTANTIATE_TEST_SUITE_P(Shapes, FlexicubesShapes, testing::ValuesIn(test::implicit_shapes()),
                         [](const testing::TestParamInfo<test::ImplicitShape>& info) {
                           std::string name = info.param.name;
                           for (char& letter : name) letter = letter == ' ' ? '_' : letter;
                           return name;
                         });

// That the whole surface is there: what it encloses, with an error of second order.
TEST(Flexicubes, EnclosesTheVolumeOfTheShape) {
  const struct {
    const char* name;
    Implicit distance;
    double volume;
    std::int64_t finest;
  } shapes[] = {{"sphere", test::sphere_at(0.4013), 4.0 / 3.0 * kPi * std::pow(0.4013, 3), 128},
                {"torus", test::torus_at(0.2803, 0.1009, {0.0011, 0.0017, -0.0007}, 2),
                 2.0 * kPi * kPi * 0.2803 * 0.1009 * 0.1009, 128},
                {"hollow sphere", test::hollow(test::sphere_at(0.3007), 0.0713),
                 4.0 / 3.0 * kPi * (std::pow(0.372, 3) - std::pow(0.2294, 3)), 64},
                {"capsule", test::capsule_between({-0.25, 0, 0.01}, {0.25, 0, 0.01}, 0.1207),
                 kPi * 0.1207 * 0.1207 * (0.5 + 4.0 / 3.0 * 0.1207), 64}};
  for (const auto& shape : shapes) {
    double previous = 1.0;
    for (std::int64_t resolution = 32; resolution <= shape.finest; resolution *= 2) {
      const ExtractedSurface surface = surface_of(shape.distance, resolution);
      const double volume = test::enclosed_volume(surface.vertices, surface.faces);
      const double error = std::abs(volume / shape.volume - 1.0);
      EXPECT_LT(error, 0.05 * std::pow(32.0 / static_cast<double>(resolution), 2))
          << shape.name << " at " << resolution;
      EXPECT_LT(error, 0.35 * previous) << shape.name << " at " << resolution;
      previous = error;
    }
  }
}

TEST(Flexicubes, CarriesLinearAttributesExactly) {
  torch::manual_seed(5);
  CubeCorners corners = test::corners_of(test::sphere_at(0.4013), 16);
  corners.weights = torch::randn_like(corners.weights);
  for (const bool training : {false, true}) {
    const ExtractedSurface surface = flexicubes(average_corners(corners, 16), training);
    const double* p = surface.vertices.data_ptr<double>();
    const double* found = surface.attributes.data_ptr<double>();
    for (std::int64_t v = 0; v < surface.vertices.size(0); ++v) {
      const double wanted = test::linear_attribute({p[3 * v], p[3 * v + 1], p[3 * v + 2]});
      // The published 1e-8 in the denominator of quad centres shrinks them; A + B is as small as 5e-5.
      ASSERT_NEAR(found[v], wanted, training ? 3e-4 : 1e-12) << v;
    }
  }
}

TEST(Flexicubes, TrainingAddsACentreToEveryQuad) {
  const CubeField field = average_corners(test::corners_of(test::torus_at(0.2803, 0.1009, {}, 2), 24), 24);
  const ExtractedSurface eval = flexicubes(field, false), train = flexicubes(field, true);
  const std::int64_t duals = eval.vertices.size(0), quads = eval.faces.size(0) / 2;
  EXPECT_EQ(train.vertices.size(0), duals + quads);
  EXPECT_EQ(train.faces.size(0), 4 * quads);
  EXPECT_TRUE(torch::equal(train.vertices.slice(0, 0, duals), eval.vertices));
  EXPECT_FALSE(eval.deviation.defined());
  EXPECT_GE(train.deviation.min().item<double>(), 0.0);
}

// Random values reach all cases, ambiguous faces and cubes with several vertices.
class FlexicubesRandomFields : public testing::TestWithParam<double> {};

TEST_P(FlexicubesRandomFields, AgreeWithTheDenseTensorVersion) {
  torch::manual_seed(6);
  CubeCorners corners = test::random_corners(9, 3, GetParam());
  const Tensor order = torch::randperm(corners.coords.size(0), torch::kInt64);
  const Tensor kept = order.slice(0, 0, 9 * order.size(0) / 10);  // some inactive cubes inside
  for (Tensor* part : {&corners.coords, &corners.sdf, &corners.deform, &corners.attributes, &corners.weights})
    *part = part->index_select(0, kept);
  const CubeField field = average_corners(corners, 9);
  for (const bool training : {false, true}) {
    const ExtractedSurface found = flexicubes(field, training);
    const ExtractedSurface wanted = benchmarks::PlainFlexicubes(field).extract(training);
    ASSERT_GT(found.faces.size(0), 100);
    ASSERT_TRUE(torch::equal(found.faces, wanted.faces));
    // Crossings next to a corner cancel digits in both.
    EXPECT_TRUE(torch::allclose(found.vertices, wanted.vertices, 1e-9, 1e-9));
    EXPECT_TRUE(torch::allclose(found.attributes, wanted.attributes, 1e-9, 1e-9));
    if (training) {
      EXPECT_NEAR(found.deviation.sum().item<double>(), wanted.deviation.sum().item<double>(), 1e-8);
    }
  }
}

INSTANTIATE_TEST_SUITE_P(MostlyInsideOrOutside, FlexicubesRandomFields, testing::Values(-0.3, 0.0, 0.3));

struct DualProblem {
  DualProblem() {
    torch::manual_seed(7);
    field = average_corners(test::random_corners(5, 2), 5);
    topology = dual_topology(field);
    const std::int64_t vertices = topology.vertex_places.size(0), cubes = topology.cubes();
    const Tensor sdf = gather_rows(field.sdf.unsqueeze(1), topology.vertices);
    rows = torch::cat({sdf, torch::randn({vertices, 5}, torch::kFloat64)}, 1);
    alpha = 0.5 + torch::rand({cubes, 8}, torch::kFloat64);
    beta = 0.5 + torch::rand({cubes, 12}, torch::kFloat64);
    values_direction = torch::randn({topology.duals, 5}, torch::kFloat64);
    deviation_direction = torch::randn({topology.crossings}, torch::kFloat64);
  }

  using Version = DualVertices (*)(const Tensor&, const Tensor&, const Tensor&, const DualTopology&, bool);
  // Values, deviation, and the gradients with respect to rows, alpha and beta.
  std::vector<Tensor> run(Version version, torch::Dtype dtype) const {
    std::vector<Tensor> inputs;
    for (const Tensor& x : {rows, alpha, beta}) inputs.push_back(x.to(dtype).detach().clone().requires_grad_());
    const DualVertices found = version(inputs[0], inputs[1], inputs[2], topology, true);
    std::vector<Tensor> results = {found.values.detach(), found.deviation.detach()};
    for (const Tensor& gradient : torch::autograd::grad({found.values, found.deviation}, inputs,
                                                        {values_direction.to(dtype), deviation_direction.to(dtype)})) {
      results.push_back(gradient);
    }
    return results;
  }

  CubeField field;
  DualTopology topology;
  Tensor rows, alpha, beta, values_direction, deviation_direction;
};

TEST(DualVertices, KernelAndItsGradientAgreeWithTensorOperations) {
  const DualProblem problem;
  const std::vector<Tensor> wanted = problem.run(tensor_dual_vertices, torch::kFloat64);
  const std::vector<Tensor> found = problem.run(dual_vertices, torch::kFloat64);
  const std::vector<Tensor> single = problem.run(dual_vertices, torch::kFloat32);
  const char* names[] = {"values", "deviation", "d rows", "d alpha", "d beta"};
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    ASSERT_EQ(found[i].sizes(), wanted[i].sizes()) << names[i];
    const double size = 1.0 + wanted[i].abs().max().item<double>();
    EXPECT_LT((found[i] - wanted[i]).abs().max().item<double>(), 1e-9 * size) << names[i];
    // Shares of a crossing are rounded to fp32; gradients divide by differences of signed distances.
    EXPECT_LT((single[i].to(torch::kFloat64) - wanted[i]).abs().max().item<double>(), 1e-4 * size) << names[i];
  }
}

TEST(DualVertices, DoNotDependOnTheNumberOfThreads) {
  const DualProblem problem;
  const int threads = at::get_num_threads();
  at::set_num_threads(1);
  const std::vector<Tensor> one = problem.run(dual_vertices, torch::kFloat32);
  at::set_num_threads(3);
  const std::vector<Tensor> three = problem.run(dual_vertices, torch::kFloat32);
  at::set_num_threads(threads);
  for (std::size_t i = 0; i < one.size(); ++i) EXPECT_TRUE(torch::equal(one[i], three[i])) << i;
}

// All outputs of a training-mode extraction, weighted so that no part cancels.
Tensor mixed_output(const CubeCorners& corners, std::int64_t resolution) {
  const ExtractedSurface surface = flexicubes(average_corners(corners, resolution), true);
  const auto wave = [](const Tensor& x) {
    return torch::sin(torch::arange(x.numel(), torch::kFloat64) * 1.7 + 0.3).view(x.sizes());
  };
  return (surface.vertices * wave(surface.vertices)).sum() + (surface.attributes * wave(surface.attributes)).sum() +
         (surface.deviation * wave(surface.deviation)).sum();
}

TEST(Flexicubes, GradientsAgreeWithDifferences) {
  torch::manual_seed(8);
  CubeCorners corners = test::random_corners(5, 2);
  // Signed distances of at least 0.05 on every vertex: no sign changes, and differences converge.
  const Tensor vertex = average_corners(corners, 5).corner_vertices.reshape({-1});
  const Tensor raw = torch::randn({vertex.max().item<std::int64_t>() + 1}, torch::kFloat64);
  const Tensor clear = torch::where(raw.lt(0), raw - 0.05, raw + 0.05);
  corners.sdf = clear.index_select(0, vertex).view(corners.sdf.sizes());
  Tensor CubeCorners::*const parts[] = {&CubeCorners::sdf, &CubeCorners::deform, &CubeCorners::attributes,
                                        &CubeCorners::weights};
  const char* names[] = {"sdf", "deform", "attributes", "weights"};
  for (std::size_t i = 0; i < 4; ++i) {
    const auto loss = [&](const Tensor& values) {
      CubeCorners moved = corners;
      moved.*parts[i] = values;
      return mixed_output(moved, 5);
    };
    const Tensor& values = corners.*parts[i];
    EXPECT_LT(test::directional_error(loss, values, torch::randn_like(values), 1e-6), 1e-5) << names[i];
  }
}

TEST(Flexicubes, GammaGetsItsGradientFromQuadCentres) {
  torch::manual_seed(9);
  CubeCorners corners = test::corners_of(test::sphere_at(0.4013), 8);
  corners.weights = torch::randn_like(corners.weights).requires_grad_();
  mixed_output(corners, 8).backward();
  EXPECT_GT(corners.weights.grad().select(1, 20).abs().max().item<double>(), 0.0);
}

TEST(Flexicubes, AFieldWithoutSignChangeHasNoSurface) {
  for (const double sign : {1.0, -1.0}) {  // outside everywhere; inside everywhere in the whole grid
    const auto constant = [=](const Place&) { return 0.3 * sign; };
    const CubeField field = average_corners(test::corners_of(constant, 4, 100.0), 4);
    const ExtractedSurface surface = flexicubes(field, true);
    EXPECT_EQ(surface.vertices.sizes(), (std::vector<std::int64_t>{0, 3}));
    EXPECT_EQ(surface.faces.sizes(), (std::vector<std::int64_t>{0, 3}));
    EXPECT_EQ(surface.faces.scalar_type(), torch::kInt64);
    EXPECT_EQ(surface.attributes.sizes(), (std::vector<std::int64_t>{0, 1}));
    EXPECT_EQ(surface.deviation.numel(), 0);
  }
}

// At the border of the grid the surface ends: edges with one face, none with more than two.
TEST(Flexicubes, StaysOpenAtTheBoundaryOfTheGrid) {
  const ExtractedSurface surface = surface_of(test::sphere_at(0.6013), 16);
  ASSERT_GT(surface.faces.size(0), 0);
  EXPECT_GT(test::unmatched_edges(surface.faces), 0);
  const auto edges = test::directed_edges(surface.faces);
  EXPECT_EQ(std::adjacent_find(edges.begin(), edges.end()), edges.end()) << "the same direction twice";
  EXPECT_LT(mean_distance(surface, test::sphere_at(0.6013)), 0.1 / 16.0);
}

// One negative corner value in one active cube: the eight cubes around that vertex make a closed box, also the seven
// that are not active, whose other vertices are +1 outside.
TEST(Flexicubes, InactiveCubesCompleteTheSurface) {
  CubeCorners corners = test::corners_of([](const Place&) { return 1.0; }, 4, 100.0);
  const std::int64_t cube = (1 * 4 + 1) * 4 + 1;
  for (Tensor* part : {&corners.coords, &corners.sdf, &corners.deform, &corners.attributes, &corners.weights})
    *part = part->slice(0, cube, cube + 1).clone();
  corners.sdf[0][7] = -1.0;  // grid vertex (2, 2, 2), the origin
  const ExtractedSurface surface = flexicubes(average_corners(corners, 4), false);
  EXPECT_EQ(surface.vertices.size(0), 8);
  EXPECT_EQ(surface.faces.size(0), 12);
  EXPECT_EQ(test::unmatched_edges(surface.faces), 0);
  // Each vertex is the mean of three crossings half a cell away along the axes.
  EXPECT_TRUE(torch::allclose(surface.vertices.abs(), torch::full({8, 3}, 0.125 / 3.0, torch::kFloat64), 0.0, 1e-9));
  EXPECT_GT(test::enclosed_volume(surface.vertices, surface.faces), 0.0);
}

// Voxels of a shell leave the inside of the shape at +1, so that a second surface appears there, facing inwards.
TEST(Flexicubes, AShellOfCubesHasAnInnerSurface) {
  CubeCorners corners = test::corners_of(test::sphere_at(0.3513), 24);
  const Tensor shell = corners.sdf.amax(1).gt(-1.5 / 24.0).nonzero().squeeze(1);
  for (Tensor* part : {&corners.coords, &corners.sdf, &corners.deform, &corners.attributes, &corners.weights})
    *part = part->index_select(0, shell);
  const ExtractedSurface surface = flexicubes(average_corners(corners, 24), false);
  EXPECT_EQ(test::unmatched_edges(surface.faces), 0);
  const double volume = test::enclosed_volume(surface.vertices, surface.faces);
  EXPECT_GT(volume, 0.0);
  EXPECT_LT(volume, 0.8 * 4.0 / 3.0 * kPi * std::pow(0.3513, 3));
}

TEST(Flexicubes, FineGridsNeedNoMemoryForTheGrid) {
  CubeCorners corners = test::corners_of(test::sphere_at(0.3), 6);
  corners.coords = corners.coords + static_cast<std::int32_t>(kMostCubeResolution - 6);
  const ExtractedSurface surface = flexicubes(average_corners(corners, kMostCubeResolution), false);
  EXPECT_EQ(test::unmatched_edges(surface.faces), 0);
  EXPECT_GT(surface.vertices.min().item<double>(), 0.499);
}

}  // namespace

namespace {

void append_bytes(std::int16_t value, std::string& bytes) {
  bytes += static_cast<char>(value & 0xff);
  bytes += static_cast<char>(value >> 8 & 0xff);
}
template <typename T, std::size_t N>
void append_bytes(const std::array<T, N>& table, std::string& bytes) {
  for (const T& item : table) append_bytes(item, bytes);
}

// Of a table as little-endian 16-bit integers in row-major order.
template <typename Table>
std::string table_digest(const Table& table) {
  std::string bytes;
  append_bytes(table, bytes);
  return sha256(bytes);
}

// Sums of docs/reference/autoencoders.md, 5.3.
TEST(FlexicubesTables, AreThePublishedOnes) {
  const FlexicubesTables& tables = flexicubes_tables();
  EXPECT_EQ(table_digest(tables.groups), "d704bd48b4b0d7a55a1d9f7647d739bc4b934c0983b877d5a4ccf5378fc515ce");
  EXPECT_EQ(table_digest(tables.counts), "a3ce4604e8fbf815bec49308d77c46029af7fabfe5438aa56bb839c3510ac2ba");
  EXPECT_EQ(table_digest(tables.ambiguity), "2619074d39d60bb57c9d30ae29239dfd5f40b324e8f63f488d6126d4f1e24198");
}

TEST(FlexicubesTables, EveryCrossingEdgeIsInOneGroup) {
  const FlexicubesTables& tables = flexicubes_tables();
  for (std::size_t c = 0; c < FlexicubesTables::kCases; ++c) {
    int crossings = 0;
    for (std::size_t edge = 0; edge < kCubeEdges; ++edge) {
      const auto& ends = kEdgeCorners[edge];
      const bool crosses = (c >> ends[0] & 1) != (c >> ends[1] & 1);
      const int group = tables.group_of_edge[c][edge], slot = tables.slot_of_edge[c][edge];
      crossings += crosses ? 1 : 0;
      ASSERT_EQ(crosses, group >= 0) << "case " << c << " edge " << edge;
      if (!crosses) continue;
      EXPECT_EQ(tables.groups[c][static_cast<std::size_t>(group)][static_cast<std::size_t>(slot)],
                static_cast<std::int16_t>(edge));
    }
    EXPECT_EQ(tables.crossings[c], crossings) << "case " << c;
  }
}

TEST(FlexicubesTables, EdgesAreFoundFromTheirLowerCorner) {
  for (int corner = 0; corner < 8; ++corner) {
    for (int axis = 0; axis < 3; ++axis) {
      if ((corner >> axis & 1) != 0) continue;
      const auto& ends = kEdgeCorners[static_cast<std::size_t>(edge_from_corner(corner, axis))];
      EXPECT_EQ(ends[0] + ends[1], corner + (corner | 1 << axis));
      EXPECT_EQ(ends[axis == 1 ? 1 : 0], corner) << "y-edges are stored from high to low";
    }
  }
}

}  // namespace

}  // namespace anigen::shape_field
