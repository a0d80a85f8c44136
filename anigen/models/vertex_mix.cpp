#include "anigen/models/vertex_mix.h"

#include <Eigen/Core>
#include <algorithm>
#include <string>

#include "anigen/core/error.h"
#include "anigen/fields/tensor_points.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/geometry/nearest_vertex.h"
#include "anigen/geometry/segment.h"
#include "anigen/nn/shape_text.h"

namespace anigen::models {
namespace {

using torch::Tensor;

constexpr double kDegenerateTriangle = 1e-12;  // 4 · area², the squared length of the cross product of two edges

void check_mix_indices(const Tensor& indices, std::int64_t count, const char* what) {
  if (indices.numel() == 0) return;
  const auto least = indices.min().item<std::int64_t>(), most = indices.max().item<std::int64_t>();
  if (least >= 0 && most < count) return;
  throw InputError(
      "", what, "index " + std::to_string(least < 0 ? least : most) + " is outside 0 to " + std::to_string(count - 1));
}

Tensor mix_faces(const Tensor& faces) {
  if (faces.dim() != 2 || faces.size(1) != 3 || faces.is_floating_point()) {
    throw InputError("", "faces", "must be integers [F, 3], found " + nn::shape_text(faces));
  }
  return faces.to(torch::kCPU, torch::kInt64).contiguous();
}

// Weights of the place on the longest edge nearest to a place on the triangle.
Eigen::Vector3d along_longest_edge(const Eigen::Vector3d& place, const Eigen::Vector3d corners[3]) {
  int start = 0;
  double longest = -1.0;
  for (int k = 0; k < 3; ++k) {
    const double length = (corners[(k + 1) % 3] - corners[k]).squaredNorm();
    if (length > longest) {
      longest = length;
      start = k;
    }
  }
  const int end = (start + 1) % 3;
  const double t = geometry::nearest_on_segment(place, corners[start], corners[end]);
  Eigen::Vector3d weights = Eigen::Vector3d::Zero();
  weights[start] = 1.0 - t;
  weights[end] = t;
  return weights;
}

}  // namespace

VertexMix surface_mix(const Tensor& face, const Tensor& barycentric, const Tensor& faces, double least) {
  const Tensor table = mix_faces(faces);
  if (face.dim() != 1 || barycentric.dim() != 2 || barycentric.size(0) != face.size(0) || barycentric.size(1) != 3) {
    throw InputError("", "barycentric",
                     "must be [Q, 3] for " + nn::shape_text(face) + " faces, found " + nn::shape_text(barycentric));
  }
  const Tensor rows = face.to(torch::kCPU, torch::kInt64);
  check_mix_indices(rows, table.size(0), "face");
  const Tensor clamped = barycentric.to(torch::kCPU, torch::kFloat32).clamp_min(0.0);
  return {table.index_select(0, rows), clamped / clamped.sum(1, /*keepdim=*/true).clamp_min(least)};
}

VertexMix nearest_surface_mix(const geometry::NearestSurface& surface, const Tensor& vertices, const Tensor& faces,
                              const Tensor& points, double least) {
  RECORD_USER_SCOPE("skin transfer: nearest surface");
  const Tensor table = mix_faces(faces);
  const std::vector<Eigen::Vector3d> corners = fields::points_of<double>(vertices, "vertices");
  check_mix_indices(table, static_cast<std::int64_t>(corners.size()), "faces");
  const std::vector<geometry::NearestPoint> places = surface.query(fields::points_of<double>(points, "points"));
  const auto count = static_cast<std::int64_t>(places.size());
  const Tensor face = torch::empty({count}, torch::kInt64), weights = torch::empty({count, 3}, torch::kFloat64);
  const auto rows = table.accessor<std::int64_t, 2>();
  auto* face_out = face.data_ptr<std::int64_t>();
  auto* weights_out = weights.data_ptr<double>();
  for (std::int64_t i = 0; i < count; ++i) {
    const geometry::NearestPoint& place = places[static_cast<std::size_t>(i)];
    const std::int64_t found = place.at.face;
    if (found >= table.size(0)) throw InputError("", "faces", "the surface was made of another mesh");
    Eigen::Vector3d triangle[3];
    for (std::int64_t k = 0; k < 3; ++k) triangle[k] = corners[static_cast<std::size_t>(rows[found][k])];
    const double squared = (triangle[1] - triangle[0]).cross(triangle[2] - triangle[0]).squaredNorm();
    const Eigen::Vector3d own =
        squared < kDegenerateTriangle ? along_longest_edge(place.position, triangle) : place.at.barycentric;
    face_out[i] = found;
    for (std::int64_t k = 0; k < 3; ++k) weights_out[3 * i + k] = own[k];
  }
  return surface_mix(face, weights, table, least);
}

VertexMix nearest_vertex_mix(const Tensor& vertices, const Tensor& points) {
  RECORD_USER_SCOPE("skin transfer: nearest vertex");
  const geometry::NearestVertex tree(fields::points_of<float>(vertices, "vertices"));
  const std::vector<std::int32_t> nearest = tree.query(fields::points_of<double>(points, "points"));
  const auto count = static_cast<std::int64_t>(nearest.size());
  const Tensor rows = torch::empty({count}, torch::kInt64);
  std::copy(nearest.begin(), nearest.end(), rows.data_ptr<std::int64_t>());
  const Tensor weights = torch::zeros({count, 3});
  weights.select(1, 0).fill_(1.0);
  return {rows.unsqueeze(1).expand({-1, 3}).contiguous(), weights};
}

Tensor mixed(const Tensor& features, const VertexMix& mix) {
  RECORD_USER_SCOPE("skin transfer: mixing features");
  const Tensor vertices = mix.vertices.to(features.device()), weights = mix.weights.to(features.options());
  check_mix_indices(mix.vertices, features.size(0), "vertex");
  Tensor sum;
  for (std::int64_t k = 0; k < 3; ++k) {
    const Tensor part = features.index_select(0, vertices.select(1, k)) * weights.select(1, k).unsqueeze(1);
    sum = k == 0 ? part : sum + part;
  }
  return sum;
}

}  // namespace anigen::models
