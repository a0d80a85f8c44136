#include "anigen/loaders/rignet/bone_slots.h"

#include <algorithm>
#include <numeric>
#include <optional>

#include "anigen/core/numeric.h"
#include "anigen/core/percentile.h"
#include "anigen/geometry/ray_caster.h"
#include "anigen/geometry/segment.h"

namespace anigen::loaders {
namespace {

constexpr double kSeenWithin = 1e-4, kSeenPercentile = 15.0, kSeenFactor = 1.3, kUnreachable = 8.0;
constexpr double kLeastDistance = 0.01, kSamePlace = 1e-6;

// Distances of one bone along straight lines, and who sees it near enough.
struct Sight {
  std::vector<double> straight;       // [V]
  std::vector<std::int32_t> seen_by;  // vertices, ascending
};

Sight sight_of(const RignetMesh& mesh, const geometry::RayCaster& caster, const Eigen::Vector3d& head,
               const Eigen::Vector3d& tail) {
  Sight sight;
  std::vector<std::int32_t> visible;
  std::vector<float> lengths;
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const Eigen::Vector3d vertex = mesh.vertices[v].cast<double>();
    const Eigen::Vector3d from = head + geometry::nearest_on_segment(vertex, head, tail) * (tail - head);
    const double length = (vertex - from).norm();
    sight.straight.push_back(length);
    if (length > kSeenWithin) {
      const std::optional<double> hit = caster.first_hit(from, vertex - from);
      if (hit && *hit < length - kSeenWithin) continue;
    }
    visible.push_back(static_cast<std::int32_t>(v));
    lengths.push_back(static_cast<float>(length));
  }
  if (visible.empty()) return sight;
  const double most = kSeenFactor * percentile(lengths, kSeenPercentile);
  for (const std::int32_t v : visible) {
    if (sight.straight[at(v)] <= most) sight.seen_by.push_back(v);
  }
  return sight;
}

bool is_tip(const BoneEnds& bones, std::size_t bone) {
  for (std::size_t other = 0; other < bones.heads.size(); ++other) {
    if (other != bone && (bones.heads[other] - bones.tails[bone]).norm() <= kSamePlace) return false;
  }
  return true;
}

}  // namespace

std::vector<double> volumetric_distances(const RignetMesh& mesh, const SurfacePaths& paths, const BoneEnds& bones) {
  const geometry::RayCaster caster(mesh.vertices, mesh.faces);
  const std::size_t count = bones.heads.size();
  std::vector<double> distances(mesh.vertices.size() * count);
  for (std::size_t k = 0; k < count; ++k) {
    const Sight sight = sight_of(mesh, caster, bones.heads[k], bones.tails[k]);
    const auto nearest = paths.from(sight.seen_by);
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
      const std::int32_t by = nearest[v].source;
      distances[v * count + k] =
          by < 0 ? kUnreachable + sight.straight[v] : nearest[v].distance + sight.straight[at(by)];
    }
    for (const std::int32_t v : sight.seen_by) distances[at(v) * count + k] = sight.straight[at(v)];
  }
  return distances;
}

models::rignet::BoneSlots bone_slots(const std::vector<double>& distances, const BoneEnds& bones, std::int64_t slots) {
  const std::size_t count = bones.heads.size();
  const auto vertices = static_cast<std::int64_t>(count == 0 ? 0 : distances.size() / count);
  std::vector<float> tips;
  for (std::size_t k = 0; k < count; ++k) tips.push_back(is_tip(bones, k) ? 1.0F : 0.0F);
  constexpr std::int64_t kNumbers = models::rignet::kBoneNumbers;
  models::rignet::BoneSlots found{torch::full({vertices, slots}, -1, torch::kInt64),
                                  torch::zeros({vertices, slots * kNumbers})};
  auto* chosen = found.bones.data_ptr<std::int64_t>();
  float* features = found.features.data_ptr<float>();
  const std::size_t filled = std::min(count, static_cast<std::size_t>(slots));
  std::vector<std::size_t> order(count);
  for (std::int64_t v = 0; v < vertices; ++v, chosen += slots, features += slots * kNumbers) {
    const double* row = distances.data() + static_cast<std::size_t>(v) * count;
    std::iota(order.begin(), order.end(), 0);
    std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(filled), order.end(),
                      [&](std::size_t a, std::size_t b) { return row[a] != row[b] ? row[a] < row[b] : a < b; });
    float* out = features;
    for (std::size_t s = 0; s < filled; ++s) {
      const std::size_t bone = order[s];
      chosen[s] = static_cast<std::int64_t>(bone);
      for (const Eigen::Vector3d* end : {&bones.heads[bone], &bones.tails[bone]}) {
        for (int axis = 0; axis < 3; ++axis) *out++ = static_cast<float>((*end)[axis]);
      }
      *out++ = static_cast<float>(1.0 / std::max(row[bone], kLeastDistance));
      *out++ = tips[bone];
    }
  }
  return found;
}

}  // namespace anigen::loaders
