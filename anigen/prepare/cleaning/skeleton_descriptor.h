#pragma once
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "anigen/asset/skeleton.h"
#include "anigen/core/json.h"

namespace anigen::prepare {

/// What is kept of a skeleton to compare it with those of other assets: where joints are in the skeleton's own bounding
/// box (centre at the origin, longest side 1), and how they hang together, whatever their order and names. Small enough
/// for a record, so that shards of a dataset can be compared after they were merged.
struct SkeletonDescriptor {
  std::string topology;              ///< equal for trees that are equal up to the order of children
  double length = 0.0;               ///< mean bone length, of the rounded places
  std::vector<std::int32_t> places;  ///< [J, 3] in 1/kPlaces of the longest side
  std::vector<std::int32_t> depths;  ///< [J] bones between the root and the joint

  static constexpr double kPlaces = 1000.0;
  std::size_t joints() const { return depths.size(); }
};

SkeletonDescriptor describe(const Skeleton& skeleton);

Json to_json(const SkeletonDescriptor& descriptor);
SkeletonDescriptor skeleton_descriptor_from_json(const Json& json);

/// Whether the trees are equal, every joint of each has one of the same depth in the other within `tolerance` (in the
/// unit of the longest side), and their mean bone lengths differ by no more than twice that.
bool near(const SkeletonDescriptor& a, const SkeletonDescriptor& b, double tolerance);

/// Published pipelines remove assets by skeleton similarity without saying which (reference anymate-baselines.md, 1.1);
/// 1 % is our choice.
inline constexpr double kNearSkeleton = 0.01;

/// For every descriptor the first earlier one that it is near to and that is itself near to none; nothing for those
/// that stay. Skeletons of fewer than `least_joints` joints are compared with none: small ones are alike by chance.
/// Compares only trees that are equal and of about one mean bone length, so the usual cost is far below n².
std::vector<std::optional<std::size_t>> near_duplicates(const std::vector<SkeletonDescriptor>& descriptors,
                                                        double tolerance = kNearSkeleton, std::size_t least_joints = 4);

}  // namespace anigen::prepare
