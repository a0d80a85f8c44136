#include "anigen/skin_correction/weights.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "anigen/core/error.h"
#include "tests/rigging/binding_shapes.h"

namespace anigen::skin_correction {
namespace {

using test::Body;

SkinCorrection small_network(std::int64_t candidates = 5) {
  torch::manual_seed(1);
  SkinCorrectionOptions options;
  options.candidates = candidates;
  options.geovoxel_resolution = 64;
  options.width = 16;
  options.num_heads = 2;
  SkinCorrection network(options);
  network->eval();
  return network;
}

TEST(CorrectedWeights, AreSoundAndWithoutLearningAMixtureOfBothMethods) {
  const Body body = test::two_fingers();
  SkinCorrection network = small_network();
  const rigging::SkinFeatures features(body.mesh, body.skeleton, network->options().features());
  const SkinWeights skin = corrected_weights(network, features, 4);
  test::expect_sound(skin, body);
  const SkinWeights all = corrected_weights(network, features, 0);
  for (std::size_t v = 0; v < all.rows(); ++v) {
    const auto place = static_cast<std::size_t>(features.place_of_vertex()[v]);
    for (int joint = 0; joint < 5; ++joint) {
      const float mixed = 0.881F * test::weight_of(features.heat(), place, joint) +
                          0.119F * test::weight_of(features.geodesic(), place, joint);
      EXPECT_NEAR(test::weight_of(all, v, joint), mixed, 1e-3) << v << ", joint " << joint;
    }
  }
}

TEST(CorrectedWeights, AreSmoothedWithinAShell) {
  const Body body = test::two_fingers();
  SkinCorrection network = small_network();
  const rigging::SkinFeatures features(body.mesh, body.skeleton, network->options().features());
  const SkinWeights sharp = corrected_weights(network, features, 0),
                    soft = corrected_weights(network, features, 0, 0.5);
  test::expect_sound(soft, body, 5);
  // Joints of each shell before and after are the same, and neighbours differ less.
  std::map<std::int32_t, std::set<std::int32_t>> joints_before, joints_after;
  for (std::size_t v = 0; v < sharp.rows(); ++v) {
    const std::int32_t shell = features.shell_of_place()[static_cast<std::size_t>(features.place_of_vertex()[v])];
    for (std::size_t i = 0; i < sharp.row_size(v); ++i) joints_before[shell].insert(sharp.row(v)[i].joint);
    for (std::size_t i = 0; i < soft.row_size(v); ++i) joints_after[shell].insert(soft.row(v)[i].joint);
  }
  EXPECT_EQ(joints_before, joints_after);
  // With P the mean over neighbours, half of P moves I − P of the weights by a factor in [0, 1] for each of its
  // eigenvectors, which are orthogonal when places count by their neighbours.
  std::vector<std::size_t> vertex_of_place(features.place_of_vertex().size(), 0);
  for (std::size_t v = 0; v < sharp.rows(); ++v)
    vertex_of_place[static_cast<std::size_t>(features.place_of_vertex()[v])] = v;
  const auto roughness = [&](const SkinWeights& skin) {
    double sum = 0.0;
    const std::set<std::int32_t> places(features.place_of_vertex().begin(), features.place_of_vertex().end());
    for (const std::int32_t place : places) {
      const auto p = static_cast<std::size_t>(place);
      const std::int32_t *first = features.neighbors_begin(p), *last = features.neighbors_end(p);
      if (first == last) continue;
      for (int joint = 0; joint < 5; ++joint) {
        double mean = 0.0;
        for (const std::int32_t* other = first; other != last; ++other)
          mean += test::weight_of(skin, vertex_of_place[static_cast<std::size_t>(*other)], joint);
        const auto count = static_cast<double>(last - first);
        const double apart = test::weight_of(skin, vertex_of_place[p], joint) - mean / count;
        sum += count * apart * apart;
      }
    }
    return sum;
  };
  EXPECT_LT(roughness(soft), 0.9 * roughness(sharp));
}

TEST(CorrectedWeights, NeedFeaturesOfTheNetworksKind) {
  const Body body = test::two_bones();
  SkinCorrection network = small_network();
  const rigging::SkinFeatures features(body.mesh, body.skeleton, {7, 64});
  EXPECT_THROW(corrected_weights(network, features, 4), InputError);
}

TEST(CorrectedWeights, OfABrokenNetworkAreRefused) {
  const Body body = test::two_bones();
  SkinCorrection network = small_network();
  {
    const torch::NoGradGuard no_grad;
    for (Tensor parameter : network->parameters()) parameter.fill_(std::numeric_limits<float>::quiet_NaN());
  }
  const rigging::SkinFeatures features(body.mesh, body.skeleton, network->options().features());
  EXPECT_THROW(corrected_weights(network, features, 4), InputError);
}

}  // namespace
}  // namespace anigen::skin_correction
