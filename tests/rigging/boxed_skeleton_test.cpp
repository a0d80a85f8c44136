// Skeletons measured by the boxes of their meshes, and the middle one of a collection.
#include <gtest/gtest.h>
#include <limits>

#include "anigen/core/error.h"
#include "anigen/rigging/rig_meshes.h"

namespace anigen::rigging {

namespace {

const Box kBox = {{-1, 0, 2}, {1, 4, 2}};  // flat along z

TEST(BoxedSkeleton, IsMeasuredByTheBoxAndPlacedInAnother) {
  const BoxedSkeleton boxed = boxed_skeleton("x", {{0, 1, 2}, {3, 4, 2}}, {-1, 0}, kBox);
  EXPECT_TRUE(boxed.joints[0].isApprox(Eigen::Vector3d(0.5, 0.25, 0.5)));
  EXPECT_TRUE(boxed.joints[1].isApprox(Eigen::Vector3d(2.0, 1.0, 0.5)));
  const auto placed = placed_joints(boxed, {{0, 0, 0}, {2, 2, 2}});
  EXPECT_TRUE(placed[1].isApprox(Eigen::Vector3d(4, 2, 1)));
  EXPECT_TRUE(placed_joints(boxed, kBox)[1].isApprox(Eigen::Vector3d(3, 4, 2)));
}

TEST(BoxedSkeleton, RefusesWhatCannotBeMeasured) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(boxed_skeleton("x", {{0, 0, 0}}, {-1}, Box()), InputError);
  EXPECT_THROW(boxed_skeleton("x", {}, {}, kBox), InputError);
  EXPECT_THROW(boxed_skeleton("x", {{0, nan, 0}}, {-1}, kBox), InputError);
}

TEST(Medoid, IsTheSkeletonNearestToAllOthers) {
  const auto at = [](double x) { return BoxedSkeleton{"", {{x, 0, 0}, {x, 1, 0}}, {-1, 0}}; };
  EXPECT_EQ(medoid({at(0.0), at(0.9), at(0.3), at(0.4), at(5.0)}), 3u);
  EXPECT_EQ(medoid({at(1.0), at(1.0)}), 0u);  // the first of equals
  EXPECT_EQ(medoid({at(7.0)}), 0u);
  EXPECT_THROW(medoid({}), InputError);
}

TEST(Medoid, ManyJointsOfOneSkeletonCountAsMuchAsOne) {
  // Distances are means over joints, so a skeleton of many joints at the same places is as near as one of few.
  BoxedSkeleton few{"", {{0, 0, 0}, {1, 0, 0}}, {-1, 0}}, many = few, far{"", {{0, 3, 0}}, {-1}};
  for (int i = 0; i < 20; ++i) many.joints.push_back({0.05 * i, 0, 0});
  EXPECT_EQ(medoid({far, few, many, few}), 1u);
}

}  // namespace

}  // namespace anigen::rigging
