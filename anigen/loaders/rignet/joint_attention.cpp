#include "anigen/loaders/rignet/joint_attention.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include "anigen/core/numeric.h"
#include "anigen/core/percentile.h"
#include "anigen/geometry/ray_caster.h"

namespace anigen::loaders {
namespace {

constexpr int kRays = 14;
constexpr double kHitPercentile = 20.0, kHitFactor = 2.0, kAttentionReach = 0.02;
constexpr std::size_t kLeastAttending = 6;

// Where the surface lies around one end of a bone.
std::vector<Eigen::Vector3d> hits_around(const geometry::RayCaster& caster, const Eigen::Vector3d& end,
                                         const Eigen::Vector3d& along) {
  const Eigen::Vector3d side = along.unitOrthogonal(), up = along.cross(side);
  std::vector<Eigen::Vector3d> ways;
  std::vector<float> distances;
  for (int ray = 0; ray < kRays; ++ray) {
    const double angle = 2.0 * kPi * ray / kRays;
    const Eigen::Vector3d way = std::cos(angle) * side + std::sin(angle) * up;
    if (const std::optional<double> hit = caster.first_hit(end, way)) {
      ways.push_back(way);
      distances.push_back(static_cast<float>(*hit));
    }
  }
  std::vector<Eigen::Vector3d> hits;
  if (distances.empty()) return hits;
  const double most = kHitFactor * percentile(distances, kHitPercentile);
  for (std::size_t i = 0; i < ways.size(); ++i) {
    if (distances[i] < most) hits.emplace_back(end + distances[i] * ways[i]);
  }
  return hits;
}

// The six vertices nearest to a joint.
std::vector<std::size_t> nearest_six(const RignetMesh& mesh, const Eigen::Vector3d& joint) {
  std::vector<std::size_t> order(mesh.vertices.size());
  std::iota(order.begin(), order.end(), 0);
  const std::size_t count = std::min(kLeastAttending, order.size());
  const auto squared = [&](std::size_t v) { return (mesh.vertices[v].cast<double>() - joint).squaredNorm(); };
  std::partial_sort(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(count), order.end(),
                    [&](std::size_t a, std::size_t b) { return squared(a) < squared(b); });
  order.resize(count);
  return order;
}

}  // namespace

torch::Tensor joint_attention(const RignetMesh& mesh, const std::vector<Eigen::Vector3d>& joints,
                              const std::vector<int>& parents) {
  const geometry::RayCaster caster(mesh.vertices, mesh.faces);
  std::vector<std::vector<Eigen::Vector3d>> hits(joints.size());
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const std::size_t parent = at(parents[j]);
    const Eigen::Vector3d bone = joints[j] - joints[parent];
    if (!(bone.norm() > 1e-9)) continue;
    for (const std::size_t end : {j, parent}) {
      const auto found = hits_around(caster, joints[end], bone.normalized());
      hits[end].insert(hits[end].end(), found.begin(), found.end());
    }
  }
  torch::Tensor attention = torch::zeros({static_cast<std::int64_t>(mesh.vertices.size())});
  float* attends = attention.data_ptr<float>();
  for (std::size_t j = 0; j < joints.size(); ++j) {
    std::size_t count = 0;
    for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
      const Eigen::Vector3d vertex = mesh.vertices[v].cast<double>();
      const bool is_near = std::any_of(hits[j].begin(), hits[j].end(), [&](const Eigen::Vector3d& hit) {
        return (hit - vertex).norm() <= kAttentionReach;
      });
      if (!is_near) continue;
      attends[v] = 1.0F;
      ++count;
    }
    if (count >= kLeastAttending) continue;
    for (const std::size_t v : nearest_six(mesh, joints[j])) attends[v] = 1.0F;
  }
  return attention;
}

}  // namespace anigen::loaders
