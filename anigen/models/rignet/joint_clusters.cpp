#include "anigen/models/rignet/joint_clusters.h"

#include <vector>

#include "anigen/models/anymate/checks.h"
#include "anigen/models/rignet/mean_shift.h"

namespace anigen::models::rignet {
namespace {

constexpr double kLowering = 1.3;  // of the least density

// The mask, unless it leaves nothing of what `within` keeps.
Tensor narrowed(const Tensor& within, const Tensor& mask) {
  const Tensor both = within & mask;
  return both.any().item<bool>() ? both : within;
}

Tensor with_mirror_images(const Tensor& points) {
  return torch::cat({points, points * torch::tensor({-1.0F, 1.0F, 1.0F})});
}

Tensor settled(Tensor points, const Tensor& attention, const Tensor& bandwidth, const JointClusters& options) {
  for (std::int64_t i = 0; i < options.most_shifts; ++i) {
    const Tensor next = mean_shifted(points, attention, bandwidth, /*step=*/1.0);
    const double moved = (next - points).norm(2, 1).sum().item<double>();
    points = next;
    if (moved < options.least_movement) break;
  }
  return points;
}

// Places in order of falling density, those that have a denser one within the bandwidth left out.
std::vector<std::int64_t> densest(const Tensor& points, const Tensor& density, double bandwidth) {
  const Tensor order = density.argsort(/*stable=*/true, 0, /*descending=*/true).contiguous();
  const auto at = points.accessor<float, 2>();
  const auto rank = order.accessor<std::int64_t, 1>();
  std::vector<std::int64_t> kept;
  for (std::int64_t i = 0; i < rank.size(0); ++i) {
    bool is_free = true;
    for (const std::int64_t other : kept) {
      double squared = 0.0;
      for (std::int64_t axis = 0; axis < 3; ++axis) {
        const double apart = at[rank[i]][axis] - at[other][axis];
        squared += apart * apart;
      }
      is_free = is_free && squared >= bandwidth * bandwidth;
    }
    if (is_free) kept.push_back(rank[i]);
  }
  return kept;
}

Tensor symmetric(const Tensor& joints, double middle) {
  const Tensor x = joints.select(1, 0);
  Tensor on = joints.index_select(0, (x.abs() <= middle).nonzero().flatten());
  on.select(1, 0).zero_();
  const Tensor beside = joints.index_select(0, (x > middle).nonzero().flatten());
  return torch::cat({on, with_mirror_images(beside)});
}

}  // namespace

Tensor clustered_joints(const Tensor& points, const Tensor& attention, const Tensor& inside,
                        const JointClusters& options) {
  anymate::require_shape(points, {-1, 3}, "points");
  const std::int64_t count = points.size(0);
  anymate::require(count > 0, "points", "there are none");
  anymate::require_shape(attention, {count}, "attention");
  anymate::require_shape(inside, {count}, "inside");
  const torch::NoGradGuard no_grad;
  const Tensor all = points.to(torch::kCPU, torch::kFloat32), attends = attention.to(torch::kCPU, torch::kFloat32);
  anymate::require(all.isfinite().all().item<bool>() && attends.isfinite().all().item<bool>(), "points",
                   "or their attention are not finite");
  Tensor kept = narrowed(torch::ones({count}, torch::kBool), inside.to(torch::kCPU));
  kept = narrowed(kept, attends > options.least_attention);
  const Tensor rows = kept.nonzero().flatten();
  Tensor moved = all.index_select(0, rows), weight = attends.index_select(0, rows);
  if (options.mirrored) {
    moved = with_mirror_images(moved);
    weight = torch::cat({weight, weight});
  }
  const Tensor bandwidth = torch::tensor(options.bandwidth, torch::kFloat32);
  moved = settled(moved, weight, bandwidth, options).contiguous();
  Tensor density = epanechnikov(moved, bandwidth).sum(1);
  density = (density / density.sum()).contiguous();

  for (double least = options.least_density;; least /= kLowering) {
    const Tensor dense = (density > least).nonzero().flatten();
    const Tensor places = moved.index_select(0, dense).contiguous();
    const auto peaks = densest(places, density.index_select(0, dense).contiguous(), options.bandwidth);
    const Tensor joints = places.index_select(0, torch::tensor(peaks, torch::kInt64));
    const Tensor found = options.mirrored ? symmetric(joints, options.middle) : joints;
    if (found.size(0) >= 2 || dense.size(0) == moved.size(0)) return found.size(0) > 0 ? found : joints;
  }
}

}  // namespace anigen::models::rignet
