#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "anigen/eval/skeleton/joint_graph.h"

namespace anigen::eval {

/// Evenly spaced points on one bone: start + i · step, i = 0 … last. Kept as a formula, since the nearest of them is
/// found by rounding a projection and no list of points is needed.
struct BoneSamples {
  Eigen::Vector3d start = Eigen::Vector3d::Zero(), step = Eigen::Vector3d::Zero();
  std::int64_t last = 0;

  Eigen::Vector3d point(std::int64_t i) const { return start + static_cast<double>(i) * step; }
};

/// More samples than this on one skeleton are refused: it is not in the unit box.
inline constexpr double kMostBoneSamples = 4e6;
inline constexpr double kSampleSpacing = 0.005;
inline constexpr int kSamplesPerBone = 100;

/// RigNet, MagicArticulate, Puppeteer: k = length / spacing rounded half to even steps, both ends included, a bone
/// shorter than half the spacing only its parent's end. Long bones so weigh more (reference training-and-data.md, 7.2
/// a).
/// @throws InputError beyond kMostBoneSamples
std::vector<BoneSamples> spaced_samples(const std::vector<BoneLine>& lines, double spacing = kSampleSpacing);

/// UniRig: `count` points per bone whatever its length, at i / count from the child towards the parent: the child's end
/// is one of them, the parent's is not (7.2 b). @throws InputError beyond kMostBoneSamples
std::vector<BoneSamples> counted_samples(const std::vector<BoneLine>& lines, int count = kSamplesPerBone);

std::int64_t sample_count(const std::vector<BoneSamples>& samples);

/// All points, bone by bone; joints shared by bones are repeated, as published.
std::vector<Eigen::Vector3d> sample_points(const std::vector<BoneSamples>& samples);

}  // namespace anigen::eval
