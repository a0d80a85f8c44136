#include "anigen/raytrace/palette.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "anigen/raytrace/srgb.h"

namespace anigen::raytrace {
namespace {

const Eigen::Vector3f kUnweighted(0.5f, 0.5f, 0.5f);

Eigen::Vector3f oklch_to_linear(float lightness, float chroma, float hue) {
  const float a = chroma * std::cos(hue), b = chroma * std::sin(hue);
  const float l = lightness + 0.3963377774f * a + 0.2158037573f * b;
  const float m = lightness - 0.1055613458f * a - 0.0638541728f * b;
  const float s = lightness - 0.0894841775f * a - 1.2914855480f * b;
  const float l3 = l * l * l, m3 = m * m * m, s3 = s * s * s;
  return {4.0767416621f * l3 - 3.3077115913f * m3 + 0.2309699292f * s3,
          -1.2684380046f * l3 + 2.6097574011f * m3 - 0.3413193965f * s3,
          -0.0041960863f * l3 - 0.7034186147f * m3 + 1.7076147010f * s3};
}

}  // namespace

Eigen::Vector3f joint_color(int joint) {
  constexpr double kGolden = 0.61803398874989485, kTwoPi = 6.28318530717958648;
  constexpr std::array<float, 3> kLightness{0.72f, 0.62f, 0.82f};
  const int index = std::max(joint, 0);
  const auto hue = static_cast<float>(kTwoPi * std::fmod(0.12 + kGolden * index, 1.0));
  const float lightness = kLightness[static_cast<std::size_t>(index) % kLightness.size()];
  // As colourful as the screen can show at this lightness and hue, up to a limit.
  Eigen::Vector3f linear = Eigen::Vector3f::Zero();
  for (float chroma = 0.18f; chroma > 0.02f; chroma -= 0.01f) {
    linear = oklch_to_linear(lightness, chroma, hue);
    if (linear.minCoeff() >= 0.0f && linear.maxCoeff() <= 1.0f) break;
  }
  return linear.cwiseMax(0.0f).unaryExpr([](float value) { return linear_to_srgb(value); });
}

Eigen::Vector3f heat_color(float value) {
  static const std::array<Eigen::Vector3f, 5> kStops{
      Eigen::Vector3f(0.16f, 0.18f, 0.42f), Eigen::Vector3f(0.13f, 0.48f, 0.60f), Eigen::Vector3f(0.45f, 0.75f, 0.45f),
      Eigen::Vector3f(0.98f, 0.85f, 0.30f), Eigen::Vector3f(0.86f, 0.18f, 0.14f)};
  const float at = std::clamp(std::isfinite(value) ? value : 0.0f, 0.0f, 1.0f) * (kStops.size() - 1);
  const std::size_t stop = std::min(static_cast<std::size_t>(at), kStops.size() - 2);
  const float fraction = at - static_cast<float>(stop);
  return (1.0f - fraction) * kStops[stop] + fraction * kStops[stop + 1];
}

std::vector<Eigen::Vector3f> weight_colors(const SkinWeights& weights) {
  std::vector<Eigen::Vector3f> colors(weights.rows(), kUnweighted);
  for (std::size_t v = 0; v < colors.size(); ++v) {
    if (weights.row_size(v) == 0) continue;
    colors[v].setZero();
    for (std::size_t i = 0; i < weights.row_size(v); ++i) {
      colors[v] += weights.row(v)[i].weight * joint_color(weights.row(v)[i].joint);
    }
  }
  return colors;
}

std::vector<Eigen::Vector3f> heat_colors(const SkinWeights& weights, const std::vector<int>& joints) {
  std::vector<Eigen::Vector3f> colors(weights.rows());
  for (std::size_t v = 0; v < colors.size(); ++v) {
    float sum = 0.0f;
    for (std::size_t i = 0; i < weights.row_size(v); ++i) {
      const Influence& influence = weights.row(v)[i];
      if (std::find(joints.begin(), joints.end(), influence.joint) != joints.end()) sum += influence.weight;
    }
    colors[v] = heat_color(sum);
  }
  return colors;
}

}  // namespace anigen::raytrace
