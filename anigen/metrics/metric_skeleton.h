#pragma once
#include <Eigen/Core>
#include <array>
#include <vector>

#include "anigen/asset/skeleton.h"
#include "anigen/geometry/bones.h"

namespace anigen::metrics {

/// A skeleton as all metrics see it: checked, with its bones. Convert once and measure with every metric; a JointTree
/// converts by itself. It may be a forest.
struct MetricSkeleton : JointTree {
  /// One bone per joint that has a parent, in joint order. A skeleton without any gives its joints, as bones without
  /// length, so that bone distances stay defined (docs/reference/training.md, 7.2).
  std::vector<geometry::Bone> bones;

  /// @param name of the skeleton in messages @throws InputError as check()
  MetricSkeleton(JointTree tree, const char* name = "");  // NOLINT(google-explicit-constructor)

  /// Joints and bones (parent, child) that need no longer be a tree (puppeteer_cleaned()); `parents` is empty.
  static MetricSkeleton graph(std::vector<Eigen::Vector3d> joints, const std::vector<std::array<int, 2>>& bones);

 private:
  MetricSkeleton() = default;
};

}  // namespace anigen::metrics
