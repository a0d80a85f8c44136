#include <gtest/gtest.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/nn/state_dict.h"
#include "anigen/vision/dinov2.h"
#include "anigen/vision/dsine.h"
#include "anigen/vision/dsine_network.h"
#include "tests/nn/largest_difference.h"
#include "tests/vision/dsine_formula.h"

namespace anigen::vision {

namespace {

using nn::largest_difference;
using Vector = std::array<double, 3>;

void expect_vector(const Tensor& found, const Vector& wanted, double tolerance, const std::string& what) {
  for (int i = 0; i < 3; ++i)
    EXPECT_NEAR(found[i].item<double>(), wanted[static_cast<std::size_t>(i)], tolerance) << what;
}

void expect_unit(const Tensor& normals) { EXPECT_LT((normals.norm(2, {1}) - 1.0).abs().max().item<double>(), 1e-5); }

// The network with the numbers of the reference, in fp64 and rounded to fp32.
class DsineNetwork : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    wide_ = Dsine();
    wide_->to(torch::kFloat64);
    test::dsine_formula_fill(wide_);
    narrow_ = Dsine();
    const std::vector<nn::StateEntry> from = nn::state_entries(*wide_), to = nn::state_entries(*narrow_);
    for (std::size_t i = 0; i < from.size(); ++i) to[i].tensor.copy_(from[i].tensor);
  }
  static void TearDownTestSuite() { wide_ = narrow_ = nullptr; }

  static inline Dsine wide_ = nullptr, narrow_ = nullptr;
};

struct PublishedMap {
  int iterations;
  Vector mean, first, middle, last;  // over the picture; pixels (0, 0), (45, 75), (89, 149)
};

const std::vector<PublishedMap>& published_maps() {
  static const std::vector<PublishedMap> kMaps = {{0,
                                                   {-0.9044534, 0.1797049, 0.3597514},
                                                   {-0.9121508, 0.1712687, 0.3723547},
                                                   {-0.8885073, -0.0342071, 0.4575857},
                                                   {-0.8562315, 0.3339545, 0.3941345}},
                                                  {1,
                                                   {-0.0834695, 0.7158724, 0.4282852},
                                                   {-0.5371601, 0.1464089, 0.8306765},
                                                   {-0.0525962, 0.5008463, 0.8639367},
                                                   {0.1617628, 0.9485182, -0.2722977}},
                                                  {2,
                                                   {0.0601938, 0.3890828, 0.6923189},
                                                   {-0.3295338, 0.2101606, 0.9204564},
                                                   {-0.2137292, 0.4953265, 0.8420045},
                                                   {0.0229662, 0.6345436, 0.7725458}},
                                                  {5,
                                                   {-0.3076675, 0.1315630, 0.8741878},
                                                   {-0.5414117, 0.0568602, 0.8388327},
                                                   {-0.4032049, 0.1380795, 0.9046324},
                                                   {0.4613088, 0.0826617, 0.8833806}}};
  return kMaps;
}

// Mean and mean of absolute values; nine digits are published.
void expect_means(const Tensor& map, torch::IntArrayRef shape, double mean, double absolute) {
  EXPECT_EQ(map.sizes(), shape);
  EXPECT_NEAR(map.mean().item<double>(), mean, 1e-8);
  EXPECT_NEAR(map.abs().mean().item<double>(), absolute, 1e-8);
}

TEST_F(DsineNetwork, AgreesWithThePublishedOne) {
  const torch::NoGradGuard no_grad;
  const Tensor picture = test::dsine_formula_picture();
  const PicturePadding padding = dsine_padding(90, 150);
  const Tensor framed = at::constant_pad_nd(picture, {padding.left, padding.right, padding.top, padding.bottom}, 0.0);
  const EncoderMaps maps = wide_->encode(imagenet_normalized(framed));
  expect_means(maps.eighth, {1, 64, 12, 20}, 0.0081309767, 0.414736596);
  expect_means(maps.sixteenth, {1, 176, 6, 10}, 0.240699894, 2.76177832);
  expect_means(maps.thirty_second, {1, 2048, 3, 5}, 0.060745769, 0.868127283);

  DsineState state = wide_->begin(maps, PinholeCamera::of_picture(90, 150).padded(padding.left, padding.top));
  Tensor normals;
  int iterations = 0;
  for (const PublishedMap& map : published_maps()) {
    for (; iterations < map.iterations; ++iterations) wide_->refine(state);
    normals = wide_->upsampled(state).slice(2, padding.top, padding.top + 90);
    normals = normals.slice(3, padding.left, padding.left + 150);
    const std::string what = "after " + std::to_string(map.iterations);
    constexpr double kTolerance = 1e-7;  // seven digits are published
    expect_vector(normals[0].mean({1, 2}), map.mean, kTolerance, what + " mean");
    expect_vector(normals[0].select(1, 0).select(1, 0), map.first, kTolerance, what + " first");
    expect_vector(normals[0].select(1, 45).select(1, 75), map.middle, kTolerance, what + " middle");
    expect_vector(normals[0].select(1, 89).select(1, 149), map.last, kTolerance, what + " last");
  }
  // The published network in fp32 differs from itself in fp64 by 8.2e-6; sums in another order by some times as much.
  const Tensor narrow = picture_normals(narrow_, picture).to(torch::kFloat64);
  ASSERT_EQ(narrow.sizes(), normals.sizes());
  const double difference = nn::largest_difference(narrow, normals);
  RecordProperty("largest_difference_of_fp32", std::to_string(difference));
  EXPECT_LT(difference, 5e-5);
}

TEST_F(DsineNetwork, ThePublishedSizesArePaddedAndCutAgain) {
  for (const auto& [height, width] : std::vector<std::pair<std::int64_t, std::int64_t>>{{33, 70}, {1, 5}}) {
    torch::manual_seed(3);
    const Tensor picture = torch::rand({1, 3, height, width});
    const Tensor normals = picture_normals(narrow_, picture);
    ASSERT_EQ(normals.sizes(), picture.sizes());
    EXPECT_EQ(nn::dtype_of(normals), torch::kFloat32);
    expect_unit(normals);

    // Computed by hand: black before normalising, the camera moved along.
    const std::int64_t rows = (height + 31) / 32 * 32, columns = (width + 31) / 32 * 32;
    const std::int64_t top = (rows - height) / 2, left = (columns - width) / 2;
    Tensor framed = torch::zeros({1, 3, rows, columns});
    framed.slice(2, top, top + height).slice(3, left, left + width).copy_(picture);
    const PinholeCamera camera = PinholeCamera::of_picture(height, width).padded(left, top);
    const Tensor all = narrow_->forward(imagenet_normalized(framed), camera);
    EXPECT_EQ(nn::largest_difference(all.slice(2, top, top + height).slice(3, left, left + width), normals), 0.0);
  }
}

TEST_F(DsineNetwork, PicturesOfABatchDoNotMix) {
  torch::manual_seed(4);
  const Tensor pictures = torch::rand({2, 3, 32, 64});
  const Tensor both = picture_normals(narrow_, pictures);
  for (int i = 0; i < 2; ++i) {
    // Rounding only: the library may sum in another order for another batch.
    EXPECT_LT(nn::largest_difference(both.slice(0, i, i + 1), picture_normals(narrow_, pictures.slice(0, i, i + 1))),
              5e-5);
  }
  EXPECT_GT(nn::largest_difference(both[0], both[1]), 0.01);
}

TEST(DsineKeys, AreTheReleasedOnes) {
  const Dsine network;
  std::map<std::string, std::int64_t> parameters, entries;  // by the leading part of the key
  std::map<std::string, std::vector<std::int64_t>> shapes;
  std::int64_t tensors = 0, elements = 0;
  for (const nn::StateEntry& entry : nn::state_entries(*network)) {
    const std::string stage = "encoder.original_model.blocks.";
    const std::string part = entry.key.substr(0, entry.key.find('.'));
    const std::string place =
        entry.key.compare(0, stage.size(), stage) == 0 ? entry.key.substr(0, stage.size() + 1) : part;
    ++entries[part];
    elements += entry.tensor.numel();
    shapes[entry.key] = entry.tensor.sizes().vec();
    EXPECT_FALSE(entry.tensor.requires_grad());
    if (entry.is_buffer) continue;
    ++tensors;
    parameters[""] += entry.tensor.numel();
    parameters[part] += entry.tensor.numel();
    if (place != part) parameters[place] += entry.tensor.numel();
    if (part == "decoder") parameters[entry.key.substr(0, entry.key.find('.', 8))] += entry.tensor.numel();
  }
  EXPECT_EQ(shapes.size(), 918u);
  EXPECT_EQ(tensors, 570);
  EXPECT_EQ(elements, 72737611);
  const std::map<std::string, std::int64_t> counts = {{"", 72564759},
                                                      {"encoder", 28340784},
                                                      {"decoder", 43386883},
                                                      {"gru", 624192},
                                                      {"prob_head", 43865},
                                                      {"xy_head", 45490},
                                                      {"angle_head", 43865},
                                                      {"up_prob_head", 79680},
                                                      {"decoder.conv2", 4200448},
                                                      {"decoder.up1", 29958144},
                                                      {"decoder.up2", 7385088},
                                                      {"decoder.normal_head", 609155},
                                                      {"decoder.feature_head", 617024},
                                                      {"decoder.hidden_head", 617024},
                                                      {"encoder.original_model.blocks.0", 5352},
                                                      {"encoder.original_model.blocks.1", 122846},
                                                      {"encoder.original_model.blocks.2", 329514},
                                                      {"encoder.original_model.blocks.3", 1632464},
                                                      {"encoder.original_model.blocks.4", 3286344},
                                                      {"encoder.original_model.blocks.5", 12165292},
                                                      {"encoder.original_model.blocks.6", 9744908}};
  EXPECT_EQ(parameters, counts);
  const std::map<std::string, std::int64_t> listed = {{"encoder", 852},   {"decoder", 36}, {"gru", 6},
                                                      {"prob_head", 6},   {"xy_head", 6},  {"angle_head", 6},
                                                      {"up_prob_head", 6}};
  EXPECT_EQ(entries, listed);

  const std::string encoder = "encoder.original_model.";
  const std::map<std::string, std::vector<std::int64_t>> some = {
      {encoder + "conv_stem.weight", {48, 3, 3, 3}},
      {encoder + "bn1.running_var", {48}},
      {encoder + "bn1.num_batches_tracked", {}},
      {encoder + "blocks.0.0.conv_dw.weight", {48, 1, 3, 3}},
      {encoder + "blocks.0.0.se.conv_reduce.weight", {12, 48, 1, 1}},
      {encoder + "blocks.0.2.se.conv_expand.weight", {24, 6, 1, 1}},
      {encoder + "blocks.0.1.conv_pw.weight", {24, 24, 1, 1}},
      {encoder + "blocks.0.1.bn2.bias", {24}},
      {encoder + "blocks.1.0.conv_pw.weight", {144, 24, 1, 1}},
      {encoder + "blocks.1.0.se.conv_reduce.bias", {6}},
      {encoder + "blocks.2.4.conv_dw.weight", {384, 1, 5, 5}},
      {encoder + "blocks.3.0.bn1.weight", {384}},
      {encoder + "blocks.5.8.conv_pwl.weight", {304, 1824, 1, 1}},
      {encoder + "blocks.6.2.bn3.running_mean", {512}},
      {encoder + "conv_head.weight", {2048, 512, 1, 1}},
      {encoder + "bn2.weight", {2048}},
      {"decoder.conv2.weight", {2048, 2050, 1, 1}},
      {"decoder.up1._net.0.weight", {1024, 2226, 3, 3}},
      {"decoder.up1._net.1.weight", {1024}},
      {"decoder.up2._net.3.weight", {512, 512, 3, 3}},
      {"decoder.up2._net.4.bias", {512}},
      {"decoder.normal_head.0.weight", {128, 514, 3, 3}},
      {"decoder.normal_head.4.weight", {3, 128, 1, 1}},
      {"decoder.hidden_head.4.bias", {64}},
      {"gru.convq.weight", {64, 130, 5, 5}},
      {"xy_head.4.weight", {50, 64, 1, 1}},
      {"up_prob_head.4.weight", {576, 64, 1, 1}}};
  for (const auto& [key, shape] : some) {
    ASSERT_EQ(shapes.count(key), 1u) << key;
    EXPECT_EQ(shapes.at(key), shape) << key;
  }
}

}  // namespace

namespace {

// Every convolution is a mean, and its bias.
Dsine averaging_network() {
  Dsine network;
  for (const nn::StateEntry& entry : nn::state_entries(*network)) {
    const bool kernel = entry.tensor.dim() == 4;
    entry.tensor.fill_(kernel ? static_cast<double>(entry.tensor.size(0)) / static_cast<double>(entry.tensor.numel())
                              : 0.1);
  }
  return network;
}

TEST(DsineNormals, AreOnePerPixel) {
  const std::unique_ptr<NormalEstimator> estimator = std::make_unique<DsineNormals>(averaging_network());
  torch::manual_seed(1);
  const torch::Tensor rgb = torch::rand({1, 3, 40, 71}), normals = estimator->normals(rgb);
  ASSERT_EQ(normals.sizes(), rgb.sizes());
  EXPECT_EQ(normals.scalar_type(), torch::kFloat32);
  EXPECT_FALSE(normals.requires_grad());
  EXPECT_LT((normals.norm(2, {1}) - 1.0).abs().max().item<float>(), 1e-5f);
  EXPECT_TRUE(torch::equal(estimator->normals(rgb), normals)) << "a second call";
}

TEST(DsineNormals, RefusesPicturesThatWouldNotFit) {
  DsineNormals estimator{Dsine()};
  const auto refusal = [&](std::int64_t height, std::int64_t width) -> std::string {
    try {
      estimator.normals(torch::zeros({1, 3, 1, 1}).expand({1, 3, height, width}));  // takes no memory
    } catch (const InputError& error) {
      return error.what();
    }
    return "accepted";
  };
  const std::string message = refusal(3000, 20000);
  for (const std::string word : {"20000 x 3000", "16777216"})
    EXPECT_NE(message.find(word), std::string::npos) << word << " in: " << message;
  EXPECT_NE(refusal(4097, 4096), "accepted");
  EXPECT_NE(refusal(1, 600000), "accepted") << "32 rows of padding";
}

}  // namespace

namespace {

using nn::largest_difference;

constexpr double kRounding = 1e-12;  // of a few operations in fp64

Tensor drawn(std::uint64_t seed, torch::IntArrayRef shape) {
  torch::manual_seed(seed);
  return torch::randn(shape, torch::kFloat64);
}

/// Unit normals that point away from a camera in front of them.
Tensor drawn_normals(std::uint64_t seed, torch::IntArrayRef shape) {
  Tensor normals = 0.4 * drawn(seed, shape);
  normals.select(1, 2) += 2.0;
  return unit_vectors(normals);
}

TEST(DsinePadding, IsEvenAndMakesMultiplesOf32) {
  const PicturePadding none = dsine_padding(64, 96);
  EXPECT_EQ(none.left + none.right + none.top + none.bottom, 0);
  const PicturePadding padding = dsine_padding(90, 151);  // the reference's sizes, one column more
  EXPECT_EQ(padding.top, 3);
  EXPECT_EQ(padding.bottom, 3);
  EXPECT_EQ(padding.left, 4);
  EXPECT_EQ(padding.right, 5);
}

TEST(DsineCamera, SeesSixtyDegreesAcrossTheLongerSide) {
  const PinholeCamera camera = PinholeCamera::of_picture(90, 150);
  EXPECT_NEAR(camera.focal_u, 75.0 * std::sqrt(3.0), 1e-10);
  EXPECT_EQ(camera.focal_u, camera.focal_v);
  const Tensor like = torch::zeros({1}, torch::kFloat64);
  const PinholeCamera padded = camera.padded(5, 3);
  const Tensor slopes = ray_slopes(padded, 96, 160, like);
  EXPECT_EQ(slopes.sizes(), torch::IntArrayRef({1, 2, 96, 160}));
  // The picture's left border is half a pixel left of the centre of its first column, 30° off the axis.
  const double half_pixel = 0.5 / camera.focal_u;
  EXPECT_NEAR(slopes[0][0][0][5].item<double>() - half_pixel, -std::tan(kPi / 6.0), kRounding);
  EXPECT_NEAR(slopes[0][1][3][0].item<double>() - half_pixel, -45.0 / camera.focal_v, kRounding);
  // A pixel of the reduced grid lies in the middle of its 8 × 8 pixels.
  const Tensor coarse = ray_slopes(padded.reduced(8), 12, 20, like);
  EXPECT_LT(nn::largest_difference(coarse, at::avg_pool2d(slopes, 8)), kRounding);
  const Tensor rays = unit_rays(slopes);
  EXPECT_LT((rays.norm(2, {1}) - 1.0).abs().max().item<double>(), kRounding);
  EXPECT_LT(nn::largest_difference(rays.slice(1, 0, 2) / rays.slice(1, 2, 3), slopes), kRounding);
}

TEST(RayRelu, RaisesTheComponentAlongTheRay) {
  const Tensor rays = unit_vectors(drawn(1, {1, 3, 4, 5})), normals = unit_vectors(drawn(2, {2, 3, 4, 5}));
  const Tensor cosine = (normals * rays).sum(1, true), raised = ray_relu(normals, rays);
  const Tensor along = (raised * rays).sum(1, true);
  ASSERT_LT(cosine.min().item<double>(), 0.0);
  ASSERT_GT(cosine.max().item<double>(), 0.01);
  EXPECT_LT((raised.norm(2, {1}) - 1.0).abs().max().item<double>(), kRounding);
  // Seen from the front: left alone.
  EXPECT_LT(((raised - normals).abs() * (cosine > 0.01)).max().item<double>(), kRounding);
  // From behind: what is across the ray stays, with 0.01 along it before the length is made 1 again.
  const Tensor across = normals - cosine * rays;
  EXPECT_LT(((raised - unit_vectors(across + 0.01 * rays)).abs() * (cosine < 0.01)).max().item<double>(), kRounding);
  EXPECT_GT(along.min().item<double>(), 0.0099);
}

TEST(Neighborhood, IsRowByRowAndRepeatsTheBorder) {
  const Tensor x = torch::arange(12, torch::kFloat64).view({1, 1, 3, 4});
  const Tensor around = neighborhood(x, 2);
  ASSERT_EQ(around.sizes(), torch::IntArrayRef({1, 1, 25, 3, 4}));
  for (std::int64_t k = 0; k < 25; ++k) {
    for (std::int64_t row = 0; row < 3; ++row) {
      for (std::int64_t column = 0; column < 4; ++column) {
        const auto at_row = std::clamp<std::int64_t>(row + k / 5 - 2, 0, 2);
        const auto at_column = std::clamp<std::int64_t>(column + k % 5 - 2, 0, 3);
        EXPECT_EQ(around[0][0][k][row][column].item<double>(), static_cast<double>(4 * at_row + at_column));
      }
    }
  }
}

TEST(RotationAxes, LieInThePlaneAndPointAlongTheDirectionInThePicture) {
  const PinholeCamera camera = PinholeCamera::of_picture(12, 16);
  const Tensor normals = drawn_normals(5, {1, 3, 25, 12, 16});
  const Tensor directions = unit_vectors(drawn(6, {1, 2, 25, 12, 16}));
  const Tensor places = neighborhood(pixel_centers(12, 16, normals), 2);
  const Tensor axes = rotation_axes(normals, directions, places, camera);
  EXPECT_LT((axes.norm(2, {1}) - 1.0).abs().max().item<double>(), kRounding);
  EXPECT_LT((axes * normals).sum(1).abs().max().item<double>(), 1e-10);
  // A step along the axis moves the picture of the point one step ahead of the place (where DSINE looks) along the
  // direction.
  const Tensor focal = camera.focal(normals).unsqueeze(2), center = camera.center(normals).unsqueeze(2);
  const Tensor slopes = (places + directions - center) / focal;
  const Tensor point = torch::cat({slopes, torch::ones_like(slopes.slice(1, 0, 1))}, 1);
  constexpr double kStep = 1e-6;
  const Tensor moved = point + kStep * axes;
  const Tensor motion = (moved.slice(1, 0, 2) / moved.slice(1, 2, 3) - slopes) * focal;
  EXPECT_LT(nn::largest_difference(unit_vectors(motion), directions), 1e-4);
}

TEST(RotationAxes, AreZeroWhereThereIsNone) {
  const PinholeCamera camera{10.0, 10.0, 4.5, 4.5};
  const Tensor like = torch::zeros({1}, torch::kFloat64);
  const Tensor places = torch::full({1, 2, 1, 1, 1}, 4.5, like.options());
  const Tensor no_direction = torch::zeros({1, 2, 1, 1, 1}, like.options());
  const auto normal = [&](double x, double y, double z) {
    return torch::tensor({x, y, z}, torch::kFloat64).view({1, 3, 1, 1, 1});
  };
  EXPECT_EQ(rotation_axes(normal(0, 0, 1), no_direction, places, camera).abs().max().item<double>(), 0.0);
  // One pixel further down, where the ray is (0, 0.1, 1), this plane is seen edge-on.
  const Tensor down = torch::tensor({0.0, 1.0}, torch::kFloat64).view({1, 2, 1, 1, 1});
  EXPECT_EQ(rotation_axes(normal(0, 1, -0.1), down, places, camera).abs().max().item<double>(), 0.0);
  // Nearly edge-on: along the ray, on the far side or on the near one.
  for (const double sign : {1.0, -1.0}) {
    const Tensor axis = rotation_axes(normal(0, 1, -0.1 + sign * 1e-10), down, places, camera);
    EXPECT_LT(nn::largest_difference(axis, -sign * unit_vectors(normal(0, 0.1, 1))), 1e-6);
  }
}

TEST(RotationAxes, NotANumberBecomesNoAxis) {
  const PinholeCamera camera{10.0, 10.0, 4.5, 4.5};
  const Tensor places = torch::full({1, 2, 1, 1, 1}, 4.5, torch::kFloat64);
  const Tensor down = torch::tensor({0.0, 1.0}, torch::kFloat64).view({1, 2, 1, 1, 1});
  const Tensor nothing = torch::zeros({1, 3, 1, 1, 1}, torch::kFloat64);  // 0 / 0
  EXPECT_EQ(rotation_axes(nothing, down, places, camera).abs().max().item<double>(), 0.0);
}

TEST(Rotated, FollowsTheRightHand) {
  const auto vector = [](double x, double y, double z) {
    return torch::tensor({x, y, z}, torch::kFloat64).view({1, 3, 1});
  };
  const auto angle = [](double value) { return torch::full({1, 1, 1}, value, torch::kFloat64); };
  EXPECT_LT(nn::largest_difference(rotated(vector(1, 0, 0), vector(0, 0, 1), angle(kPi / 2)), vector(0, 1, 0)),
            kRounding);
  EXPECT_LT(nn::largest_difference(rotated(vector(0, 1, 0), vector(1, 0, 0), angle(kPi / 3)),
                                   vector(0, 0.5, std::sqrt(0.75))),
            kRounding);
  // As it is where there is no axis, by however much it should turn.
  EXPECT_EQ(nn::largest_difference(rotated(vector(0, 0.6, 0.8), vector(0, 0, 0), angle(2.5)), vector(0, 0.6, 0.8)),
            0.0);
  // A turn and the turn back.
  const Tensor axes = unit_vectors(drawn(7, {1, 3, 100})), vectors = drawn(8, {1, 3, 100});
  const Tensor angles = drawn(9, {1, 1, 100});
  const Tensor turned = rotated(vectors, axes, angles);
  EXPECT_LT(nn::largest_difference(rotated(turned, axes, -angles), vectors), kRounding);
  EXPECT_LT(nn::largest_difference((turned * axes).sum(1), (vectors * axes).sum(1)), kRounding);
  EXPECT_GT(nn::largest_difference(turned, vectors), 0.1);
}

class PropagatedNormals : public testing::Test {
 protected:
  static constexpr std::int64_t kHeight = 5, kWidth = 7;
  PinholeCamera camera_ = PinholeCamera::of_picture(kHeight, kWidth);
  Tensor normals_ = drawn_normals(10, {2, 3, kHeight, kWidth});
  Tensor rays_ = unit_rays(ray_slopes(camera_, kHeight, kWidth, normals_));
  NeighborRotations rotations_ = {torch::rand({2, 25, kHeight, kWidth}, torch::kFloat64),
                                  unit_vectors(drawn(11, {2, 2, 25, kHeight, kWidth})),
                                  torch::zeros({2, 25, kHeight, kWidth}, torch::kFloat64)};
};

TEST_F(PropagatedNormals, WithoutATurnAreThoseOfTheNeighbor) {
  const Tensor around = neighborhood(normals_, 2);
  for (const std::int64_t k : {0, 7, 12, 23}) {
    rotations_.weights.zero_();
    rotations_.weights.select(1, k).fill_(0.3);
    const Tensor found = propagated_normals(normals_, rotations_, camera_, rays_);
    EXPECT_LT(nn::largest_difference(found, ray_relu(around.select(2, k), rays_)), kRounding) << k;
  }
}

TEST_F(PropagatedNormals, OfAPlaneStayWithoutATurn) {
  const Tensor plane = unit_vectors(torch::tensor({0.1, -0.2, 1.0}, torch::kFloat64).view({1, 3, 1, 1}));
  const Tensor same = plane.expand_as(normals_).contiguous();
  EXPECT_LT(nn::largest_difference(propagated_normals(same, rotations_, camera_, rays_), same), kRounding);
}

TEST_F(PropagatedNormals, TurnByTheAngleAboutAnAxisInTheirPlane) {
  constexpr double kAngle = 0.05;  // small enough to stay in sight of the camera
  rotations_.weights.zero_();
  rotations_.weights.select(1, 12).fill_(1.0);
  rotations_.angles.fill_(kAngle);
  const Tensor found = propagated_normals(normals_, rotations_, camera_, rays_);
  const Tensor cosine = (found * normals_).sum(1);
  EXPECT_LT((cosine - std::cos(kAngle)).abs().max().item<double>(), kRounding);
}

TEST(ConvexUpsampling, OfAConstantIsTheConstant) {
  const Tensor x = torch::tensor({0.6, -0.3, 2.0}, torch::kFloat64).view({1, 3, 1, 1}).expand({2, 3, 3, 4});
  const Tensor fine = convex_upsampling(x.contiguous(), drawn(12, {2, 576, 3, 4}));
  ASSERT_EQ(fine.sizes(), torch::IntArrayRef({2, 3, 24, 32}));
  EXPECT_LT(nn::largest_difference(fine, x.slice(2, 0, 1).slice(3, 0, 1)), kRounding);
}

TEST(ConvexUpsampling, TakesTheNeighborThatTheMaskNames) {
  const Tensor x = drawn(13, {1, 2, 3, 4}), around = neighborhood(x, 1);
  const std::int64_t q = 5, a = 3, b = 6;  // the neighbour to the right, at row 3 and column 6 within the pixel
  Tensor mask = torch::zeros({1, 576, 3, 4}, torch::kFloat64);
  mask.select(1, q * 64 + a * 8 + b).fill_(1e3);
  const Tensor fine = convex_upsampling(x, mask);
  const auto all = [](std::int64_t start) { return torch::indexing::Slice(start, torch::indexing::None, 8); };
  using torch::indexing::Slice;
  EXPECT_LT(nn::largest_difference(fine.index({Slice(), Slice(), all(a), all(b)}), around.select(2, q)), kRounding);
  EXPECT_LT(nn::largest_difference(fine.index({Slice(), Slice(), all(b), all(a)}), around.mean(2)), kRounding);
}

}  // namespace

}  // namespace anigen::vision
