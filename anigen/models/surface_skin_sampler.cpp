#include "anigen/models/surface_skin_sampler.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "anigen/core/error.h"

namespace anigen::models {
namespace {

using torch::Tensor;

constexpr double kSmallestArea = 1e-12;

void check_mesh(const Tensor& vertices, const Tensor& faces) {
  if (vertices.dim() != 2 || vertices.size(1) != 3) throw InputError("", "", "vertices must have shape [V, 3]");
  if (faces.dim() != 2 || faces.size(1) != 3 || faces.is_floating_point()) {
    throw InputError("", "", "faces must be integers of shape [F, 3]");
  }
  if (faces.size(0) == 0) throw InputError("", "", "a mesh without faces has no surface to draw points from");
  if (faces.min().item<std::int64_t>() < 0 || faces.max().item<std::int64_t>() >= vertices.size(0)) {
    throw InputError("", "", "a face names a vertex outside [0, " + std::to_string(vertices.size(0)) + ")");
  }
}

Tensor face_areas(const Tensor& vertices, const Tensor& faces) {
  const auto corner = [&](std::int64_t k) { return vertices.index_select(0, faces.select(1, k).to(torch::kInt64)); };
  const Tensor a = corner(0);
  const Tensor crosses = torch::linalg_cross(corner(1) - a, corner(2) - a);
  const Tensor areas = (0.5 * crosses.norm(2, -1)).clamp_min(kSmallestArea);
  return torch::isfinite(areas).all().item<bool>() ? areas : torch::ones_like(areas);
}

}  // namespace

Tensor face_probabilities(const Tensor& vertices, const Tensor& faces) {
  check_mesh(vertices, faces);
  const Tensor areas = face_areas(vertices, faces);
  return areas / areas.sum();
}

Tensor interpolate_skin(const Tensor& skin, const Tensor& faces, const Tensor& face, const Tensor& u, const Tensor& v) {
  const std::int64_t count = face.size(0), joints = skin.size(1);
  const Tensor weights = skin.to(torch::kFloat32).contiguous();
  const auto corners = faces.accessor<std::int64_t, 2>();
  const auto face_of = face.accessor<std::int64_t, 1>();
  const auto u_of = u.accessor<float, 1>();
  const auto v_of = v.accessor<float, 1>();
  Tensor sampled = torch::empty({count, joints});
  const float* rows = weights.data_ptr<float>();
  float* out = sampled.data_ptr<float>();
  for (std::int64_t k = 0; k < count; ++k, out += joints) {
    const float root = std::sqrt(u_of[k]);
    const float bary[3] = {1.0F - root, root * (1.0F - v_of[k]), root * v_of[k]};
    const auto corner = corners[face_of[k]];
    const float* a = rows + corner[0] * joints;
    const float* b = rows + corner[1] * joints;
    const float* c = rows + corner[2] * joints;
    for (std::int64_t j = 0; j < joints; ++j) out[j] = bary[0] * a[j] + bary[1] * b[j] + bary[2] * c[j];
  }
  return sampled;
}

SurfaceSkinSampler::SurfaceSkinSampler(const Tensor& vertices, const Tensor& faces, const Tensor& skin) {
  const Tensor areas = face_probabilities(vertices, faces).to(torch::kFloat64).contiguous();
  if (skin.dim() != 2 || skin.size(0) != vertices.size(0) || skin.size(1) == 0) {
    throw InputError("", "", "skin weights must have one row per vertex, " + std::to_string(vertices.size(0)));
  }
  faces_ = faces.to(torch::kInt64).contiguous();
  skin_ = skin.to(torch::kFloat32).contiguous();
  double sum = 0.0;
  for (std::int64_t f = 0; f < areas.size(0); ++f) cumulative_.push_back(sum += areas.data_ptr<double>()[f]);
}

Tensor SurfaceSkinSampler::sample(std::int64_t count, Rng& rng) const {
  Tensor face = torch::empty({count}, torch::kInt64), u = torch::empty({count}), v = torch::empty({count});
  for (std::int64_t k = 0; k < count; ++k) {
    const auto found = std::upper_bound(cumulative_.begin(), cumulative_.end(), rng.uniform() * cumulative_.back());
    const auto last = static_cast<std::int64_t>(cumulative_.size()) - 1;  // rounding may reach the end
    face.data_ptr<std::int64_t>()[k] = std::min<std::int64_t>(found - cumulative_.begin(), last);
    u.data_ptr<float>()[k] = static_cast<float>(rng.uniform());
    v.data_ptr<float>()[k] = static_cast<float>(rng.uniform());
  }
  return interpolate_skin(skin_, faces_, face, u, v);
}

}  // namespace anigen::models
