#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/skin_weights.h"

namespace anigen::raytrace {

/// A colour per joint (sRGB in [0, 1]) that depends on the index only, so that a joint keeps its colour across
/// pictures. Hues step by the golden ratio, which sets neighbours far apart, at lightnesses that alternate; both are
/// those of OKLab (Ottosson 2020), in which no hue looks darker than another.
Eigen::Vector3f joint_color(int joint);

/// Dark blue over teal and yellow to red for values in [0, 1] (sRGB); others are clamped.
Eigen::Vector3f heat_color(float value);

/// Σ_j w_vj · joint_color(j) per vertex (sRGB); grey for an empty row.
std::vector<Eigen::Vector3f> weight_colors(const SkinWeights& weights);

/// heat_color(Σ_{j in joints} w_vj) per vertex (sRGB).
std::vector<Eigen::Vector3f> heat_colors(const SkinWeights& weights, const std::vector<int>& joints);

}  // namespace anigen::raytrace
