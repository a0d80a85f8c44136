#include "anigen/sparse/tap_plan.h"

#include <algorithm>

namespace anigen::sparse {
namespace {

constexpr std::int64_t kTaps = 27;

}  // namespace

TapPlan submanifold_plan() {
  TapPlan plan;
  for (std::int64_t tap = 0; tap < kTaps; ++tap) plan.links.push_back({tap, 0, 0, tap});
  return plan;
}

TapPlan subdivision_plan() {
  TapPlan plan;
  plan.to_children = 8;
  for (std::int64_t child = 0; child < 8; ++child) {
    for (std::int64_t side = 0; side < 8; ++side) {
      // Along an axis, bit 0 of a child sees the voxel before its own and its own, bit 1 its own and the next.
      const std::int64_t x = child / 4 + side / 4, y = child / 2 % 2 + side / 2 % 2, z = child % 2 + side % 2;
      plan.links.push_back({(x * 3 + y) * 3 + z, 0, child, child * 8 + side});
    }
  }
  return plan;
}

TapPlan reversed(const TapPlan& plan) {
  TapPlan back;
  back.from_children = plan.to_children;
  back.to_children = plan.from_children;
  for (const TapLink& link : plan.links) {
    back.links.push_back({kTaps - 1 - link.tap, link.to_child, link.from_child, link.matrix});
  }
  std::stable_sort(back.links.begin(), back.links.end(),
                   [](const TapLink& a, const TapLink& b) { return a.to_child < b.to_child; });
  return back;
}

}  // namespace anigen::sparse
