#pragma once
#include <cstddef>
#include <vector>

#include "anigen/core/random.h"
#include "anigen/geometry/surface_point.h"
#include "anigen/loaders/rigged_item.h"

namespace anigen::loaders {

/// Draws points on the surface of one asset, and the skin weights there. Set up once, drawn from at every step.
class SkinSampler {
 public:
  /// @param with_blends also prepares draw() with blend_share > 0
  SkinSampler(const RiggedItem& item, bool with_blends);

  /// One point: uniform over the surface (reference training-and-data.md, 3.1), or, with probability blend_share,
  /// with a density proportional to how blended the skin of its face is: 1 − the largest weight at its middle.
  geometry::SurfacePoint draw(double blend_share, Rng& rng) const;

  std::size_t bytes() const { return (areas_.size() + blends_.size()) * sizeof(double); }

 private:
  std::vector<double> areas_, blends_;  // [F] running sums of probability; blends_ empty when nothing is blended
};

/// Adds the barycentric mean of the three vertices' weights to out. @param joint_of where each joint of the asset
/// goes @param out [joints after that map], set to zero by the caller
void add_weights_at(const RiggedItem& item, const geometry::SurfacePoint& point, const std::vector<int>& joint_of,
                    float* out);

}  // namespace anigen::loaders
