#include "anigen/models/normal_estimator/dsine.h"

#include <gtest/gtest.h>

#include <array>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "anigen/models/dinov2.h"
#include "anigen/models/normal_estimator/picture_normals.h"
#include "tests/models/dsine_formula.h"
#include "tests/nn/largest_difference.h"

namespace anigen::models {
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
    const std::vector<StateEntry> from = state_entries(*wide_), to = state_entries(*narrow_);
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
  const double difference = largest_difference(narrow, normals);
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

    // The same by hand: black before normalising, the camera moved along.
    const std::int64_t rows = (height + 31) / 32 * 32, columns = (width + 31) / 32 * 32;
    const std::int64_t top = (rows - height) / 2, left = (columns - width) / 2;
    Tensor framed = torch::zeros({1, 3, rows, columns});
    framed.slice(2, top, top + height).slice(3, left, left + width).copy_(picture);
    const PinholeCamera camera = PinholeCamera::of_picture(height, width).padded(left, top);
    const Tensor all = narrow_->forward(imagenet_normalized(framed), camera);
    EXPECT_EQ(largest_difference(all.slice(2, top, top + height).slice(3, left, left + width), normals), 0.0);
  }
}

TEST_F(DsineNetwork, PicturesOfABatchDoNotMix) {
  torch::manual_seed(4);
  const Tensor pictures = torch::rand({2, 3, 32, 64});
  const Tensor both = picture_normals(narrow_, pictures);
  for (int i = 0; i < 2; ++i) {
    // Rounding only: the library may sum in another order for another batch.
    EXPECT_LT(largest_difference(both.slice(0, i, i + 1), picture_normals(narrow_, pictures.slice(0, i, i + 1))), 5e-5);
  }
  EXPECT_GT(largest_difference(both[0], both[1]), 0.01);
}

TEST(DsineKeys, AreTheReleasedOnes) {
  const Dsine network;
  std::map<std::string, std::int64_t> parameters, entries;  // by the leading part of the key
  std::map<std::string, std::vector<std::int64_t>> shapes;
  std::int64_t tensors = 0, elements = 0;
  for (const StateEntry& entry : state_entries(*network)) {
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
}  // namespace anigen::models
