#include "anigen/shape_field/cube_field.h"

#include <ATen/Parallel.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <map>
#include <set>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/shape_field/grid.h"
#include "tests/shape_field/implicit_shapes.h"
#include "tests/shape_field/mesh_checks.h"

namespace anigen::shape_field {
namespace {

using Vertex = std::array<std::int64_t, 3>;

// A third of the cubes of a small grid in random order.
CubeCorners scattered_corners(std::int64_t resolution, torch::Dtype dtype = torch::kFloat64) {
  torch::manual_seed(3);
  CubeCorners all = test::random_corners(resolution, 5);
  const Tensor chosen = torch::randperm(all.coords.size(0), torch::kInt64).slice(0, 0, all.coords.size(0) / 3);
  const auto rows = [&](const Tensor& values) { return values.index_select(0, chosen).to(dtype); };
  return {all.coords.index_select(0, chosen), rows(all.sdf), rows(all.deform), rows(all.attributes), rows(all.weights)};
}

// Corner values as they are averaged, [C, 8, 1 + 3 + A].
Tensor stacked(const CubeCorners& corners) {
  return torch::cat({corners.sdf.unsqueeze(-1), corners.deform, corners.attributes}, 2);
}
Tensor stacked(const CubeField& field) {
  return torch::cat({field.sdf.unsqueeze(-1), field.deform, field.attributes}, 1);
}

TEST(GridSets, ShiftedUnionsAreThoseOfSets) {
  const GridSet set = {0, 1, 2, 7, 9, 40};
  for (const std::int64_t step : {1, 2, 33, -7}) {
    std::set<std::int64_t> wanted(set.begin(), set.end());
    for (const std::int64_t number : set) wanted.insert(number + step);
    EXPECT_EQ(with_shifted(set, step), GridSet(wanted.begin(), wanted.end())) << step;
  }
  EXPECT_TRUE(with_shifted({}, 5).empty());
}

TEST(GridSets, SortLargeNumbersStably) {
  torch::manual_seed(4);
  const Tensor random = torch::randint(0, std::int64_t{1} << 60, {5000}, torch::kInt64);
  std::vector<std::int64_t> numbers(random.data_ptr<std::int64_t>(), random.data_ptr<std::int64_t>() + 5000);
  numbers[17] = numbers[4000];
  std::vector<std::int32_t> wanted(numbers.size());
  for (std::size_t i = 0; i < wanted.size(); ++i) wanted[i] = static_cast<std::int32_t>(i);
  std::stable_sort(wanted.begin(), wanted.end(), [&](std::int32_t a, std::int32_t b) {
    return numbers[static_cast<std::size_t>(a)] < numbers[static_cast<std::size_t>(b)];
  });
  EXPECT_EQ(sorting_order(numbers), wanted);
  EXPECT_TRUE(sorting_order({}).empty());
}

TEST(CubeField, VerticesAreMeansOfTheCornersThatTouchThem) {
  const CubeCorners corners = scattered_corners(5);
  const CubeField field = average_corners(corners, 5);
  const Tensor values = stacked(corners), means = stacked(field);
  std::map<Vertex, std::vector<Tensor>> touching;  // in lexicographic order
  for (std::int64_t c = 0; c < corners.coords.size(0); ++c) {
    for (std::int64_t k = 0; k < 8; ++k) {
      const auto at = [&](std::int64_t axis) { return corners.coords[c][axis].item<std::int64_t>() + (k >> axis & 1); };
      const Vertex vertex = {at(0), at(1), at(2)};
      touching[vertex].push_back(values[c][k]);
      const Tensor found = field.vertices[field.corner_vertices[c][k].item<std::int64_t>()];
      EXPECT_TRUE(torch::equal(found, torch::tensor({vertex[0], vertex[1], vertex[2]}, torch::kInt32)));
    }
  }
  ASSERT_EQ(field.vertices.size(0), static_cast<std::int64_t>(touching.size()));
  std::int64_t row = 0;
  for (const auto& [vertex, list] : touching) {
    EXPECT_TRUE(torch::equal(field.vertices[row], torch::tensor({vertex[0], vertex[1], vertex[2]}, torch::kInt32)));
    EXPECT_TRUE(torch::allclose(means[row], torch::stack(list).mean(0), 1e-12, 1e-12));
    ++row;
  }
}

// The pass over all channels at once against sums of rows, in fp32, with strides as a decoder's channels have them.
TEST(CubeField, MeansAndConsistencyEqualTheTensorForm) {
  const CubeCorners source = scattered_corners(6, torch::kFloat32);
  const std::int64_t cubes = source.coords.size(0);
  const Tensor all = torch::cat(
      {source.sdf, source.deform.reshape({cubes, -1}), source.weights, source.attributes.reshape({cubes, -1})}, 1);
  const auto split = [&](const Tensor& feats) {
    const std::vector<Tensor> parts = feats.split_with_sizes({8, 24, kCubeWeights, 40}, 1);
    return CubeCorners{source.coords, parts[0], parts[1].view({cubes, 8, 3}), parts[3].view({cubes, 8, 5}), parts[2]};
  };
  const Tensor a = all.clone().set_requires_grad(true), b = all.clone().set_requires_grad(true);
  const CubeCorners corners = split(a);
  const CubeField field = average_corners(corners, 6);
  const Tensor consistency = corner_consistency(corners, field);

  const Tensor values = stacked(split(b)).reshape({cubes * 8, -1}), rows = field.corner_vertices.reshape({-1});
  const auto sum = [&](const Tensor& x) {
    return torch::zeros({field.vertices.size(0), x.size(1)}, x.options()).index_add(0, rows, x);
  };
  const Tensor means = sum(values) / sum(torch::ones({cubes * 8, 1}));
  EXPECT_TRUE(torch::allclose(stacked(field), means, 1e-6, 1e-6));
  const Tensor wanted = (values - means.index_select(0, rows)).square().mean();
  EXPECT_NEAR(consistency.item<float>(), wanted.item<float>(), 1e-6F * wanted.item<float>());
  (stacked(field).pow(3).sum() + 100.0 * consistency).backward();
  (means.pow(3).sum() + 100.0 * wanted).backward();
  EXPECT_TRUE(torch::allclose(a.grad(), b.grad(), 1e-5, 1e-6));
}

TEST(CubeField, PositionsAreDeformedByAtMostHalfACell) {
  CubeCorners corners = scattered_corners(4);
  corners.deform = 100.0 * corners.deform;
  const CubeField field = average_corners(corners, 4);
  const Tensor grid = field.vertices.to(torch::kFloat64) / 4.0 - 0.5;
  EXPECT_TRUE(torch::allclose(field.grid_positions(), grid, 0.0, 1e-15));
  EXPECT_TRUE(torch::allclose(field.positions(), grid + torch::tanh(field.deform) / 8.0, 0.0, 1e-8));
  EXPECT_LT((field.positions() - grid).abs().max().item<double>(), 1.0 / 8.0);
}

TEST(CubeField, DoesNotDependOnTheOrderOfCubes) {
  const CubeCorners corners = scattered_corners(5);
  const Tensor order = torch::randperm(corners.coords.size(0), torch::kInt64);
  const auto rows = [&](const Tensor& values) { return values.index_select(0, order); };
  const CubeCorners shuffled = {rows(corners.coords), rows(corners.sdf), rows(corners.deform), rows(corners.attributes),
                                rows(corners.weights)};
  const CubeField a = average_corners(corners, 5), b = average_corners(shuffled, 5);
  EXPECT_TRUE(torch::equal(a.vertices, b.vertices));
  EXPECT_TRUE(torch::equal(stacked(a), stacked(b)));  // each vertex adds its corners in the order of corner numbers
}

TEST(CubeField, DoesNotDependOnTheNumberOfThreads) {
  torch::manual_seed(4);
  const CubeCorners corners = test::random_corners(16, 3);
  const int threads = at::get_num_threads();
  at::set_num_threads(1);
  const CubeField one = average_corners(corners, 16);
  const Tensor consistency = corner_consistency(corners, one);
  at::set_num_threads(3);
  const CubeField three = average_corners(corners, 16);
  EXPECT_TRUE(torch::equal(stacked(one), stacked(three)));
  EXPECT_TRUE(torch::equal(consistency, corner_consistency(corners, three)));
  at::set_num_threads(threads);
}

TEST(CubeField, ConsistencyIsTheMeanSquaredDeviation) {
  for (const torch::Dtype dtype : {torch::kFloat64, torch::kFloat32}) {
    const CubeCorners corners = scattered_corners(5, dtype);
    const CubeField field = average_corners(corners, 5);
    const Tensor expanded = stacked(field).index_select(0, field.corner_vertices.reshape({-1}));
    const Tensor values = stacked(corners);
    const Tensor wanted = (values - expanded.view(values.sizes())).square().mean();
    const Tensor found = corner_consistency(corners, field);
    EXPECT_EQ(found.scalar_type(), dtype);
    EXPECT_NEAR(found.item<double>(), wanted.item<double>(), dtype == torch::kFloat64 ? 1e-12 : 1e-6);
  }
}

TEST(CubeField, GradientsAgreeWithDifferences) {
  const CubeCorners corners = scattered_corners(4);
  const Tensor direction = torch::randn_like(corners.attributes);
  const auto mean_of_attributes = [&](const Tensor& attributes) {
    CubeCorners moved = corners;
    moved.attributes = attributes;
    return average_corners(moved, 4).attributes.pow(3).sum();
  };
  EXPECT_LT(test::directional_error(mean_of_attributes, corners.attributes, direction, 1e-5), 1e-6);
  // The whole derivative, through the means as well.
  const auto consistency = [&](const Tensor& attributes) {
    CubeCorners moved = corners;
    moved.attributes = attributes;
    return corner_consistency(moved, average_corners(moved, 4));
  };
  EXPECT_LT(test::directional_error(consistency, corners.attributes, direction, 1e-4), 1e-6);
  const auto of_distances = [&](const Tensor& sdf) {
    CubeCorners moved = corners;
    moved.sdf = sdf;
    const CubeField field = average_corners(moved, 4);
    return corner_consistency(moved, field) + field.sdf.pow(3).sum();
  };
  EXPECT_LT(test::directional_error(of_distances, corners.sdf, torch::randn_like(corners.sdf), 1e-5), 1e-6);
}

// Predicted rows with 2 skin features and 3 colours.
constexpr CornerLayout kLayout{/*colors=*/3, /*skin=*/2};

struct PredictedCase {
  explicit PredictedCase(torch::Dtype dtype) {
    const CubeCorners corners = scattered_corners(5);
    coords = corners.coords;
    feats = torch::randn({coords.size(0), kLayout.channels()}, torch::kFloat64).to(dtype);
  }
  // The field and both regularisers by separate operations.
  PredictedField written_out(const Tensor& rows) const {
    const std::int64_t cubes = rows.size(0);
    const std::vector<Tensor> parts = rows.split_with_sizes({8, 24, kCubeWeights, 24, 16}, 1);
    const CubeCorners corners{
        coords, parts[0] - 1.0 / 5.0, parts[1].view({cubes, 8, 3}),
        torch::cat({parts[4].view({cubes, 8, 2}), torch::sigmoid(parts[3]).view({cubes, 8, 3})}, 2), parts[2]};
    PredictedField predicted;
    predicted.field = average_corners(corners, 5);
    predicted.consistency = corner_consistency(corners, predicted.field);
    predicted.weights_length = corners.weights.narrow(1, 0, kRegularWeights).abs().mean();
    return predicted;
  }
  // Something that depends on every result.
  static Tensor loss(const PredictedField& predicted) {
    return stacked(predicted.field).pow(3).sum() + predicted.field.weights.pow(2).sum() + 50.0 * predicted.consistency +
           20.0 * predicted.weights_length;
  }

  Tensor coords, feats;
};

TEST(PredictedField, IsWhatSeparateOperationsGive) {
  for (const torch::Dtype dtype : {torch::kFloat64, torch::kFloat32}) {
    const PredictedCase c(dtype);
    const double limit = dtype == torch::kFloat64 ? 1e-12 : 1e-5;
    const Tensor a = c.feats.clone().set_requires_grad(true), b = c.feats.clone().set_requires_grad(true);
    const PredictedField found = predicted_field(c.coords, a, kLayout, 5), wanted = c.written_out(b);
    EXPECT_TRUE(torch::equal(found.field.vertices, wanted.field.vertices));
    EXPECT_TRUE(torch::equal(found.field.corner_vertices, wanted.field.corner_vertices));
    EXPECT_TRUE(torch::equal(found.field.sdf, wanted.field.sdf));
    EXPECT_TRUE(torch::equal(found.field.deform, wanted.field.deform));
    EXPECT_TRUE(torch::equal(found.field.weights, wanted.field.weights));
    EXPECT_TRUE(torch::allclose(found.field.attributes, wanted.field.attributes, limit, limit));
    EXPECT_NEAR(found.consistency.item<double>(), wanted.consistency.item<double>(), limit);
    EXPECT_NEAR(found.weights_length.item<double>(), wanted.weights_length.item<double>(), limit);
    const auto slopes = [](const PredictedField& predicted, const Tensor& x) {
      return torch::autograd::grad({PredictedCase::loss(predicted)}, {x})[0];
    };
    EXPECT_TRUE(torch::allclose(slopes(found, a), slopes(wanted, b), limit, limit));
  }
}

TEST(PredictedField, GradientAgreesWithDifferencesAndMayBeOfOneResult) {
  const PredictedCase c(torch::kFloat64);
  const auto loss = [&](const Tensor& rows) {
    return PredictedCase::loss(predicted_field(c.coords, rows, kLayout, 5));
  };
  EXPECT_LT(test::directional_error(loss, c.feats, torch::randn_like(c.feats), 1e-5), 1e-6);
  const auto of_distances = [&](const Tensor& rows) {
    return predicted_field(c.coords, rows, kLayout, 5).field.sdf.pow(3).sum();
  };
  EXPECT_LT(test::directional_error(of_distances, c.feats, torch::randn_like(c.feats), 1e-5), 1e-6);
}

TEST(PredictedField, BitsDoNotDependOnThreads) {
  const PredictedCase c(torch::kFloat32);
  const int threads = at::get_num_threads();
  std::vector<Tensor> first;
  for (const int count : {1, 3}) {
    at::set_num_threads(count);
    const Tensor rows = c.feats.clone().set_requires_grad(true);
    const Tensor loss = PredictedCase::loss(predicted_field(c.coords, rows, kLayout, 5));
    const std::vector<Tensor> found{loss.detach(), torch::autograd::grad({loss}, {rows})[0]};
    if (first.empty()) first = found;
    for (std::size_t i = 0; i < found.size(); ++i) EXPECT_TRUE(torch::equal(found[i], first[i])) << i;
  }
  at::set_num_threads(threads);
}

TEST(PredictedField, TakesNoCubesAndRefusesOtherWidths) {
  const PredictedCase c(torch::kFloat32);
  const PredictedField none = predicted_field(c.coords.slice(0, 0, 0), c.feats.slice(0, 0, 0), kLayout, 5);
  EXPECT_EQ(none.field.vertices.size(0), 0);
  EXPECT_EQ(none.consistency.item<double>() + none.weights_length.item<double>(), 0.0);
  EXPECT_THROW(predicted_field(c.coords, c.feats.slice(1, 1), kLayout, 5), InputError);
  EXPECT_THROW(predicted_field(c.coords.slice(0, 1), c.feats, kLayout, 5), InputError);
}

TEST(CubeField, NeedsNoMemoryForTheGrid) {
  CubeCorners corners = scattered_corners(2);
  const std::int64_t far = kMostCubeResolution - 2;
  corners.coords = corners.coords + static_cast<std::int32_t>(far);
  const CubeField field = average_corners(corners, kMostCubeResolution);
  EXPECT_EQ(field.vertices.max().item<std::int64_t>(), field.coords.max().item<std::int64_t>() + 1);
}

TEST(CubeField, TakesNoCubes) {
  CubeCorners corners = scattered_corners(3);
  for (Tensor* part : {&corners.coords, &corners.sdf, &corners.deform, &corners.attributes, &corners.weights})
    *part = part->slice(0, 0, 0);
  const CubeField field = average_corners(corners, 3);
  EXPECT_EQ(field.vertices.size(0), 0);
  EXPECT_EQ(corner_consistency(corners, field).item<double>(), 0.0);
}

TEST(CubeField, RefusesWhatDoesNotFit) {
  const CubeCorners good = scattered_corners(4);
  EXPECT_THROW(average_corners(good, 0), InputError);
  EXPECT_THROW(average_corners(good, kMostCubeResolution + 1), InputError);
  EXPECT_THROW(average_corners(good, 2), InputError) << "cubes outside a smaller grid";
  CubeCorners bad = good;
  bad.coords = good.coords.clone();
  bad.coords[0].copy_(good.coords[1]);
  EXPECT_THROW(average_corners(bad, 4), InputError) << "a cube twice";
  bad.coords = -good.coords - 1;
  EXPECT_THROW(average_corners(bad, 4), InputError) << "negative places";
  bad.coords = good.coords.to(torch::kFloat32);
  EXPECT_THROW(average_corners(bad, 4), InputError) << "places that are no integers";
  bad = good;
  bad.deform = good.deform.slice(0, 1);
  EXPECT_THROW(average_corners(bad, 4), InputError) << "another number of cubes";
  bad = good;
  bad.weights = good.weights.slice(1, 1);
  EXPECT_THROW(average_corners(bad, 4), InputError) << "20 weights";
  bad = good;
  bad.attributes = good.attributes.to(torch::kFloat32);
  EXPECT_THROW(average_corners(bad, 4), InputError) << "two types";
  bad = good;
  bad.sdf = Tensor();
  EXPECT_THROW(average_corners(bad, 4), InputError) << "nothing";
}

}  // namespace
}  // namespace anigen::shape_field
