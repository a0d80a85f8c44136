#include "anigen/shape_field/mesh_extraction.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <tuple>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/shape_field/grid.h"
#include "tests/shape_field/implicit_shapes.h"
#include "tests/shape_field/mesh_checks.h"

namespace anigen::shape_field {
namespace {

// The deterministic values of docs/reference/autoencoders.md, Appendix B: U(k, n) for n = 0, 1, … in [-1, 1).
std::vector<double> golden_values(std::uint64_t k, std::size_t count) {
  std::vector<double> values;
  for (std::uint64_t n = 0; n < count; ++n) {
    std::uint64_t s = (k << 32) + n + 0x9E3779B97F4A7C15ULL;
    s = (s ^ (s >> 30)) * 0xBF58476D1CE4E5B9ULL;
    s = (s ^ (s >> 27)) * 0x94D049BB133111EBULL;
    s ^= s >> 31;
    values.push_back(static_cast<double>(s >> 40) / 8388608.0 - 1.0);
  }
  return values;
}

// Channels of all cubes of a grid whose signed distances are those of a shape, plus noise in every channel.
struct Channels {
  Tensor coords, feats;
};

Channels noisy_sphere(std::int64_t resolution, const MeshFieldOptions& options, const std::vector<double>& noise,
                      double distance_noise) {
  const auto size = static_cast<double>(resolution);
  const auto width = static_cast<std::size_t>(options.channels());
  std::vector<std::int32_t> coords;
  std::vector<double> feats = noise;
  std::size_t row = 0;
  for (std::int32_t x = 0; x < resolution; ++x) {
    for (std::int32_t y = 0; y < resolution; ++y) {
      for (std::int32_t z = 0; z < resolution; ++z, ++row) {
        coords.insert(coords.end(), {x, y, z});
        for (std::size_t k = 0; k < 8; ++k) {
          const auto bit = [&](std::size_t axis) { return static_cast<double>(k >> axis & 1); };
          const double distance = test::length_of((x + bit(0)) / size - 0.5 - 0.03, (y + bit(1)) / size - 0.5 + 0.02,
                                                  (z + bit(2)) / size - 0.5 - 0.01);
          double& value = feats[row * width + k];
          value = distance - 0.31 + 1.0 / size + distance_noise * value;  // the bias −1/R is added by the extraction
        }
      }
    }
  }
  const auto count = static_cast<std::int64_t>(row);
  return {torch::tensor(coords, torch::kInt32).view({count, 3}),
          torch::tensor(feats, torch::kFloat64).view({count, options.channels()})};
}

MeshFieldOptions options_of(std::int64_t resolution) {
  MeshFieldOptions options;
  options.resolution = resolution;
  return options;
}

Channels golden_channels() { return noisy_sphere(8, options_of(8), golden_values(1000011, 512 * 133), 0.06); }

void expect_sums(const Tensor& values, double sum, double absolute, const std::vector<double>& first) {
  EXPECT_NEAR(values.sum().item<double>(), sum, 1e-6 * absolute);
  EXPECT_NEAR(values.abs().sum().item<double>(), absolute, 2e-6 * absolute);
  for (std::size_t i = 0; i < first.size(); ++i) {
    EXPECT_NEAR(values.reshape({-1})[static_cast<std::int64_t>(i)].item<double>(), first[i], 2e-6);
  }
}

void expect_face(const Tensor& faces, std::int64_t row, const std::vector<std::int64_t>& face) {
  EXPECT_TRUE(torch::equal(faces[row], torch::tensor(face, torch::kInt64))) << "face " << row;
}

// The numbers of docs/reference/autoencoders.md, 6.
TEST(MeshExtraction, ReproducesTheGoldenEvaluation) {
  const Channels in = golden_channels();
  const ExtractedMesh mesh = extract_mesh(in.coords, in.feats.to(torch::kFloat32), options_of(8), false);
  ASSERT_EQ(mesh.vertices.size(0), 122);
  expect_sums(mesh.vertices, 1.492826, 55.753642, {-0.268398, -0.148172, -0.033323, -0.251674});
  expect_sums(mesh.attributes, 366.702477, 366.702477, {0.484663, 0.553399, 0.486898, 0.514725});
  expect_sums(mesh.skin_features, -4.396893, 43.652387, {0.226988, -0.062525, -0.050075, -0.112613});
  ASSERT_EQ(mesh.faces.size(0), 240);
  expect_face(mesh.faces, 0, {0, 1, 2});
  expect_face(mesh.faces, 1, {2, 1, 3});
  expect_face(mesh.faces, 2, {2, 3, 5});
  expect_face(mesh.faces, -1, {116, 121, 117});
  EXPECT_EQ(mesh.faces.sum().item<std::int64_t>(), 43569);
  EXPECT_TRUE(mesh.success);
  EXPECT_FALSE(mesh.regularizer.defined());
}

TEST(MeshExtraction, ReproducesTheGoldenTraining) {
  const Channels in = golden_channels();
  const ExtractedMesh mesh = extract_mesh(in.coords, in.feats.to(torch::kFloat32), options_of(8), true);
  ASSERT_EQ(mesh.vertices.size(0), 242);
  expect_sums(mesh.vertices, 2.911186, 107.726446, {-0.268398, -0.148172, -0.033323, -0.251674});
  expect_sums(mesh.attributes, 727.463087, 727.463087, {});
  expect_sums(mesh.skin_features, -8.815356, 76.530343, {});
  ASSERT_EQ(mesh.faces.size(0), 480);
  expect_face(mesh.faces, 0, {0, 1, 122});
  expect_face(mesh.faces, 1, {1, 3, 122});
  expect_face(mesh.faces, 2, {3, 2, 122});
  expect_face(mesh.faces, -1, {116, 120, 241});
  EXPECT_EQ(mesh.faces.sum().item<std::int64_t>(), 145208);
  EXPECT_NEAR(mesh.regularizer.item<double>(), 0.249642, 1e-6);
  const double terms = mesh.terms.consistency.item<double>() + 0.5 * mesh.terms.deviation.item<double>() +
                       0.2 * mesh.terms.weights.item<double>();
  EXPECT_NEAR(mesh.regularizer.item<double>(), terms, 1e-6);
}

// One group of channels after the other.
TEST(MeshExtraction, GradientsAgreeWithDifferences) {
  torch::manual_seed(10);
  MeshFieldOptions options = options_of(6);
  options.skin_channels = 2;
  const std::vector<double> noise(216 * static_cast<std::size_t>(options.channels()), 0.0);
  const Channels in = noisy_sphere(6, options, noise, 0.0);
  const Tensor feats = in.feats + 0.02 * torch::randn_like(in.feats);
  feats.slice(1, 32, 52).add_(0.3);  // away from the kink of |w|
  const auto loss = [&](const Tensor& values) {
    const ExtractedMesh mesh = extract_mesh(in.coords, values, options, true);
    return 10.0 * mesh.regularizer + mesh.vertices.pow(3).sum() + mesh.attributes.square().sum() +
           mesh.skin_features.sin().sum() + mesh.field.positions().square().mean() + mesh.field.sdf.square().mean();
  };
  const std::array<std::int64_t, 8> bounds = {0, 8, 32, 44, 52, 53, 101, options.channels()};
  for (std::size_t group = 0; group + 1 < bounds.size(); ++group) {
    Tensor direction = torch::zeros_like(feats);
    direction.slice(1, bounds[group], bounds[group + 1]).normal_();
    // Steps short enough that no deviation changes its sign; gamma, which moves little, has none.
    const double step = bounds[group] == 52 ? 1e-4 : 1e-6;
    EXPECT_LT(test::directional_error(loss, feats, direction, step), 1e-4) << "channels from " << bounds[group];
  }
}

TEST(MeshExtraction, WithoutColourOrSkinThereIsNone) {
  for (const bool color : {false, true}) {
    MeshFieldOptions options = options_of(6);
    options.use_color = color;
    options.skin_channels = color ? 0 : 3;
    const std::vector<double> noise(216 * static_cast<std::size_t>(options.channels()), 0.1);
    const Channels in = noisy_sphere(6, options, noise, 0.0);
    const ExtractedMesh mesh = extract_mesh(in.coords, in.feats, options, true);
    EXPECT_TRUE(mesh.success);
    EXPECT_EQ(mesh.attributes.defined(), color);
    EXPECT_EQ(mesh.skin_features.defined(), !color);
    if (color) {
      EXPECT_EQ(mesh.attributes.size(1), 6);
    } else {
      EXPECT_EQ(mesh.skin_features.size(1), 3);
    }
  }
}

TEST(MeshExtraction, AnEmptyFieldHasNoMeshButARegularizer) {
  MeshFieldOptions options = options_of(4);
  const Tensor coords = torch::tensor({0, 1, 2, 3, 3, 3}, torch::kInt32).view({2, 3});
  const Tensor feats = torch::ones({2, options.channels()}).requires_grad_();
  options.skin_interp_sparse = true;
  const ExtractedMesh mesh = extract_mesh(coords, feats, options, true);
  EXPECT_FALSE(mesh.success);
  EXPECT_EQ(mesh.vertices.size(0), 0);
  EXPECT_EQ(mesh.faces.size(0), 0);
  EXPECT_EQ(mesh.attributes.size(0), 0);
  EXPECT_EQ(mesh.skin_features.size(1), 4);
  EXPECT_EQ(mesh.terms.deviation.item<float>(), 0.0F);
  EXPECT_NEAR(mesh.regularizer.item<float>(), 0.2F, 1e-6F) << "weights of 1";
  mesh.regularizer.backward();
  EXPECT_TRUE(torch::isfinite(feats.grad()).all().item<bool>());
  const ExtractedMesh nothing = extract_mesh(coords.slice(0, 0, 0), feats.detach().slice(0, 0, 0), options, true);
  EXPECT_FALSE(nothing.success);
  EXPECT_EQ(nothing.regularizer.item<float>(), 0.0F);
}

TEST(MeshExtraction, DisabledDeformationLeavesTheGridStraight) {
  MeshFieldOptions options = options_of(8);
  options.disable_deform = true;
  const Channels in = golden_channels();
  const ExtractedMesh mesh = extract_mesh(in.coords, in.feats, options, false);
  EXPECT_TRUE(torch::equal(mesh.field.positions(), mesh.field.grid_positions()));
  const ExtractedMesh deformed = extract_mesh(in.coords, in.feats, options_of(8), false);
  EXPECT_TRUE(torch::equal(mesh.faces, deformed.faces));
  EXPECT_FALSE(torch::allclose(mesh.vertices, deformed.vertices));
  EXPECT_TRUE(torch::allclose(mesh.skin_features, deformed.skin_features, 1e-12, 1e-12));
}

TEST(MeshExtraction, SwitchesOfTheSkinFeaturesDoWhatTheirNamesSay) {
  const Channels in = golden_channels();
  const auto features = [&](auto set) {
    MeshFieldOptions options = options_of(8);
    set(options);
    return extract_mesh(in.coords, in.feats, options, false).skin_features;
  };
  const Tensor plain = features([](MeshFieldOptions&) {});
  const Tensor sparse = features([](MeshFieldOptions& o) { o.skin_interp_sparse = true; });
  const Tensor nearest = features([](MeshFieldOptions& o) { o.skin_interp_sparse = o.skin_interp_nearest = true; });
  const Tensor deformed =
      features([](MeshFieldOptions& o) { o.skin_interp_sparse = o.skin_interp_use_deformed_grid = true; });
  const Tensor trilinear =
      features([](MeshFieldOptions& o) { o.skin_interp_sparse = o.skin_interp_trilinear = o.disable_deform = true; });
  for (const Tensor& other : {sparse, nearest, deformed, trilinear}) {
    EXPECT_EQ(other.sizes(), plain.sizes());
    EXPECT_FALSE(torch::allclose(other, plain));
  }
  EXPECT_FALSE(torch::allclose(sparse, nearest));
  EXPECT_FALSE(torch::allclose(sparse, deformed));
  // Without their condition switches do nothing.
  EXPECT_TRUE(torch::equal(plain, features([](MeshFieldOptions& o) { o.skin_interp_nearest = true; })));
  EXPECT_TRUE(torch::equal(plain, features([](MeshFieldOptions& o) { o.skin_interp_trilinear = true; })));
  EXPECT_TRUE(torch::equal(
      sparse, features([](MeshFieldOptions& o) { o.skin_interp_sparse = o.skin_interp_trilinear = true; })));
  EXPECT_TRUE(torch::equal(trilinear, features([](MeshFieldOptions& o) { o.skin_nodeform_trilinear = true; })));
}

CubeField part_of_a_grid() {
  torch::manual_seed(11);
  CubeCorners corners = test::random_corners(7, 3);
  const Tensor kept = torch::randperm(343, torch::kInt64).slice(0, 0, 60);
  for (Tensor* part : {&corners.coords, &corners.sdf, &corners.deform, &corners.attributes, &corners.weights})
    *part = part->index_select(0, kept);
  return average_corners(corners, 7);
}

TEST(SkinFeatureInterpolation, FindsTheNearestVertices) {
  const CubeField field = part_of_a_grid();
  const Tensor points = 1.4 * torch::rand({200, 3}, torch::kFloat64) - 0.7;  // also outside the grid
  for (const bool deformed : {false, true}) {
    for (const std::int64_t count : {1, 8}) {
      const NearestGridVertices found = nearest_grid_vertices(field, points, count, deformed);
      const Tensor places = deformed ? field.positions() : field.grid_positions();
      const Tensor squared = (points.unsqueeze(1) - places.unsqueeze(0)).square().sum(2);
      const Tensor wanted = std::get<0>(squared.topk(count, 1, /*largest=*/false, /*sorted=*/true));
      EXPECT_TRUE(torch::allclose(found.squared, wanted, 1e-12, 1e-15));
      EXPECT_TRUE(torch::allclose(squared.gather(1, found.rows), wanted, 1e-12, 1e-15));
    }
  }
  const Tensor far = torch::full({1, 3}, 1e6, torch::kFloat64), nan = torch::full({1, 3}, NAN, torch::kFloat64);
  EXPECT_GT(nearest_grid_vertices(field, far, 1, true).squared.item<double>(), 1e12);
  EXPECT_EQ(nearest_grid_vertices(field, nan, 1, true).rows.item<std::int64_t>(), 0);
}

TEST(SkinFeatureInterpolation, WeighsByAGaussian) {
  const CubeField field = part_of_a_grid();
  const Tensor points = torch::rand({50, 3}, torch::kFloat64) - 0.5;
  const NearestGridVertices near = nearest_grid_vertices(field, points, 8, false);
  const Tensor weights = torch::softmax(near.squared / (-2.0 * std::pow(1.5 / 7.0, 2)), 1);
  const Tensor rows = field.attributes.index_select(0, near.rows.view({-1})).view({50, 8, 3});
  EXPECT_TRUE(torch::allclose(interpolate_from_nearest(field, field.attributes, points, 8, false),
                              (rows * weights.unsqueeze(-1)).sum(1), 1e-9, 1e-9));
  const auto loss = [&](const Tensor& features) {
    return interpolate_from_nearest(field, features, points, 8, true).pow(3).sum();
  };
  EXPECT_LT(test::directional_error(loss, field.attributes, torch::randn_like(field.attributes), 1e-5), 1e-6);
}

// Such a grid has no table of its lines.
TEST(SkinFeatureInterpolation, FindsTheNearestVerticesOfAFineGrid) {
  CubeCorners corners = test::random_corners(4, 3);
  corners.coords = corners.coords + 1100;
  const CubeField field = average_corners(corners, 2000);
  const Tensor places = field.grid_positions();
  const Tensor points = places.index_select(0, torch::arange(0, 100, 3, torch::kInt64)) + 1e-4;
  const NearestGridVertices found = nearest_grid_vertices(field, points, 8, false);
  const Tensor squared = (points.unsqueeze(1) - places.unsqueeze(0)).square().sum(2);
  const Tensor wanted = std::get<0>(squared.topk(8, 1, /*largest=*/false, /*sorted=*/true));
  EXPECT_TRUE(torch::allclose(found.squared, wanted, 1e-12, 1e-15));
}

// The sums of the fused kernel, in its order, against gathered rows.
TEST(SkinFeatureInterpolation, EqualsTheTensorFormInFp32) {
  const CubeField field = part_of_a_grid();
  const Tensor points = torch::rand({300, 3}, torch::kFloat64) - 0.5;
  const NearestGridVertices near = nearest_grid_vertices(field, points, 8, false);
  const double deviation = 1.5 / 7.0;
  const Tensor gaussian = torch::exp(near.squared / (-2.0 * deviation * deviation));
  const Tensor weights = (gaussian / gaussian.sum(1, true)).to(torch::kFloat32);
  const Tensor a = field.attributes.detach().to(torch::kFloat32).set_requires_grad(true);
  const Tensor b = a.detach().clone().set_requires_grad(true);
  const Tensor found = interpolate_from_nearest(field, a, points, 8, false);
  const Tensor rows = b.index_select(0, near.rows.view({-1})).view({300, 8, b.size(1)});
  const Tensor wanted = (rows * weights.unsqueeze(-1)).sum(1);
  EXPECT_TRUE(torch::allclose(found, wanted, 1e-6, 1e-6));
  found.pow(3).sum().backward();
  wanted.pow(3).sum().backward();
  EXPECT_TRUE(torch::allclose(a.grad(), b.grad(), 1e-5, 1e-6));
}

// Those of some vertices are the rows of all, with the same gradient.
TEST(SkinFeatureInterpolation, OfSomeVerticesEqualsThatOfAll) {
  const Channels in = golden_channels();
  for (const bool sparse : {false, true}) {
    MeshFieldOptions options = options_of(8);
    options.skin_interp_sparse = sparse;
    const auto run = [&](SkinFeatures extent, const Tensor& feats) {
      const ExtractedMesh mesh = extract_mesh(in.coords, feats, options, true, extent);
      const bool wanted = extent == SkinFeatures::kOfAllVertices || !sparse;
      EXPECT_EQ(mesh.skin_features.defined(), wanted);
      torch::manual_seed(14);
      const Tensor some = torch::randperm(mesh.vertices.size(0), torch::kInt64).slice(0, 0, 40);
      if (wanted) {
        const Tensor all = mesh.skin_features;
        EXPECT_TRUE(torch::equal(skin_features_at(mesh, options, some), all.index_select(0, some)));
        return all.index_select(0, some);
      }
      return skin_features_at(mesh, options, some);
    };
    const Tensor a = in.feats.detach().clone().set_requires_grad(true), b = a.detach().clone().set_requires_grad(true);
    const Tensor all = run(SkinFeatures::kOfAllVertices, a), some = run(SkinFeatures::kWhenAskedFor, b);
    EXPECT_TRUE(torch::equal(all, some));
    all.sin().sum().backward();
    some.sin().sum().backward();
    EXPECT_TRUE(torch::allclose(a.grad(), b.grad(), 1e-12, 1e-12));
  }
}

TEST(SkinFeatureInterpolation, TrilinearKeepsLinearFunctionsAndZerosOutside) {
  const CubeField full = average_corners(test::corners_of(test::sphere_at(0.3), 6, 100.0), 6);
  torch::manual_seed(12);
  const Tensor points = torch::rand({100, 3}, torch::kFloat64) - 0.5;
  const Tensor found = interpolate_trilinearly(full, full.attributes, points);
  for (std::int64_t i = 0; i < points.size(0); ++i) {
    const auto at_axis = [&](std::int64_t axis) { return points[i][axis].item<double>(); };
    EXPECT_NEAR(found[i][0].item<double>(), test::linear_attribute({at_axis(0), at_axis(1), at_axis(2)}), 1e-12);
  }
  // A point in the highest corner reads that corner, also where fp32 cannot tell R − 1e-6 from R.
  const Tensor corner = torch::full({1, 3}, 0.5, torch::kFloat64);
  EXPECT_NEAR(interpolate_trilinearly(full, full.attributes, corner).item<double>(),
              test::linear_attribute({0.5, 0.5, 0.5}), 1e-5);
  const auto loss = [&](const Tensor& p) { return interpolate_trilinearly(full, full.attributes, p).pow(3).sum(); };
  EXPECT_LT(test::directional_error(loss, points, torch::randn_like(points), 1e-6), 1e-5);

  const CubeField part = part_of_a_grid();
  const Tensor at_vertices = interpolate_trilinearly(part, part.attributes, part.grid_positions());
  EXPECT_TRUE(torch::allclose(at_vertices, part.attributes, 1e-4, 1e-4));
  const Tensor shifted = part.grid_positions() + 3.0;  // clamped to a corner of the grid
  EXPECT_EQ(interpolate_trilinearly(part, part.attributes, shifted).size(0), shifted.size(0));
}

TEST(MeshExtraction, RefusesWhatDoesNotFit) {
  const MeshFieldOptions options = options_of(4);
  const Tensor coords = torch::zeros({1, 3}, torch::kInt32), feats = torch::zeros({1, options.channels()});
  EXPECT_THROW(extract_mesh(coords, feats.slice(1, 1), options, false), InputError) << "a channel short";
  EXPECT_THROW(extract_mesh(coords, feats[0], options, false), InputError) << "one axis";
  EXPECT_THROW(extract_mesh(coords, Tensor(), options, false), InputError) << "nothing";
  EXPECT_THROW(extract_mesh(coords, feats.repeat({2, 1}), options, false), InputError) << "two rows for one voxel";
  EXPECT_THROW(extract_mesh(coords.repeat({2, 1}), feats.repeat({2, 1}), options, false), InputError)
      << "a voxel twice";
  EXPECT_THROW(extract_mesh(coords + 4, feats, options, false), InputError) << "outside the grid";
  EXPECT_THROW(extract_mesh(coords, feats.to(torch::kHalf), options, false), InputError) << "fp16";
  EXPECT_THROW(extract_mesh(coords, feats, options_of(0), false), InputError) << "no resolution";
  const ExtractedMesh mesh = extract_mesh(coords, torch::full_like(feats, NAN), options, false);
  EXPECT_FALSE(mesh.success) << "nothing is inside where the field is NaN";
}

}  // namespace
}  // namespace anigen::shape_field
