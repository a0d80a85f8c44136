#include "anigen/skin_field/sampling.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "anigen/core/error.h"
#include "anigen/geometry/bones.h"
#include "anigen/geometry/nearest_point.h"
#include "anigen/geometry/nearest_surface.h"
#include "anigen/nn/init.h"

namespace anigen::skin_field {

namespace {

using torch::Tensor;

void check_asset(const Tensor& joints, const Tensor& parents, const std::string& file, const std::string& place) {
  if (joints.dim() != 2 || joints.size(1) != 3 || !joints.is_floating_point())
    throw InputError(file, place, "joints must be floating-point values of shape [J, 3]");
  if (joints.size(0) == 0) throw InputError(file, place, "the skeleton has no joints");
  if (parents.dim() != 1 || parents.size(0) != joints.size(0) || parents.is_floating_point())
    throw InputError(file, place, "parents must be " + std::to_string(joints.size(0)) + " integers, one per joint");
  if (!torch::isfinite(joints).all().item<bool>()) throw InputError(file, place, "a joint position is not finite");
}

constexpr double kSmallestArea = 1e-12;

void check_mesh(const Tensor& vertices, const Tensor& faces) {
  if (vertices.dim() != 2 || vertices.size(1) != 3) throw InputError("", "", "vertices must have shape [V, 3]");
  if (faces.dim() != 2 || faces.size(1) != 3 || faces.is_floating_point())
    throw InputError("", "", "faces must be integers of shape [F, 3]");
  if (faces.size(0) == 0) throw InputError("", "", "a mesh without faces has no surface to draw points from");
  if (faces.min().item<std::int64_t>() < 0 || faces.max().item<std::int64_t>() >= vertices.size(0))
    throw InputError("", "", "a face names a vertex outside [0, " + std::to_string(vertices.size(0)) + ")");
}

Tensor face_areas(const Tensor& vertices, const Tensor& faces) {
  const auto corner = [&](std::int64_t k) { return vertices.index_select(0, faces.select(1, k).to(torch::kInt64)); };
  const Tensor a = corner(0);
  const Tensor crosses = torch::linalg_cross(corner(1) - a, corner(2) - a);
  const Tensor areas = (0.5 * crosses.norm(2, -1)).clamp_min(kSmallestArea);
  return torch::isfinite(areas).all().item<bool>() ? areas : torch::ones_like(areas);
}

constexpr double kDegenerateTriangle = 1e-12;  // 4 · area², the squared length of the cross product of two edges

void check_mix_indices(const Tensor& indices, std::int64_t count, const char* what) {
  if (indices.numel() == 0) return;
  const auto least = indices.min().item<std::int64_t>(), most = indices.max().item<std::int64_t>();
  if (least >= 0 && most < count) return;
  throw InputError(
      "", what, "index " + std::to_string(least < 0 ? least : most) + " is outside 0 to " + std::to_string(count - 1));
}

Tensor mix_faces(const Tensor& faces) {
  if (faces.dim() != 2 || faces.size(1) != 3 || faces.is_floating_point())
    throw InputError("", "faces", "must be integers [F, 3], found " + nn::shape_text(faces));
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

SkeletonBatch SkeletonBatch::from_lists(const std::vector<Tensor>& joints, const std::vector<Tensor>& parents,
                                        const std::string& file) {
  if (joints.empty() || joints.size() != parents.size()) {
    throw InputError(file, "",
                     "a batch needs one list of parents per skeleton: " + std::to_string(joints.size()) +
                         " skeletons, " + std::to_string(parents.size()) + " lists of parents");
  }
  std::vector<std::int64_t> lengths, parent_rows, anchor_rows;
  std::int64_t total = 0;
  for (const Tensor& asset : joints) total += asset.dim() > 0 ? asset.size(0) : 0;
  for (std::size_t i = 0; i < joints.size(); ++i) {
    const std::string place = "skeleton " + std::to_string(i);
    check_asset(joints[i], parents[i], file, place);
    const std::int64_t count = joints[i].size(0), offset = static_cast<std::int64_t>(parent_rows.size());
    const Tensor indices = parents[i].to(torch::kCPU, torch::kInt64).contiguous();
    for (std::int64_t j = 0; j < count; ++j) {
      const std::int64_t parent = indices.data_ptr<std::int64_t>()[j];
      if (parent < -1 || parent >= count) {
        throw InputError(file, place,
                         "joint " + std::to_string(j) + " has parent " + std::to_string(parent) + ", but there are " +
                             std::to_string(count) + " joints");
      }
      parent_rows.push_back(parent < 0 ? total : offset + parent);
      anchor_rows.push_back(parent < 0 ? offset : offset + parent);
    }
    lengths.push_back(count);
  }
  SkeletonBatch batch;
  batch.joints = joints.size() == 1 ? joints[0] : torch::cat(joints, 0);
  const auto options = torch::TensorOptions().dtype(torch::kInt64);
  batch.parent_rows = nn::to_device(torch::tensor(parent_rows, options), batch.joints.device());
  batch.anchor_rows = nn::to_device(torch::tensor(anchor_rows, options), batch.joints.device());
  batch.items = nn::Ragged(lengths);
  return batch;
}

SkeletonBatch SkeletonBatch::to(torch::Device device) const {
  SkeletonBatch moved = *this;
  moved.joints = nn::to_device(joints, device);
  moved.parent_rows = nn::to_device(parent_rows, device);
  moved.anchor_rows = nn::to_device(anchor_rows, device);
  return moved;
}

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
  if (skin.dim() != 2 || skin.size(0) != vertices.size(0) || skin.size(1) == 0)
    throw InputError("", "", "skin weights must have one row per vertex, " + std::to_string(vertices.size(0)));
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
  const std::vector<Eigen::Vector3d> corners = nn::points_of<double>(vertices, "vertices");
  check_mix_indices(table, static_cast<std::int64_t>(corners.size()), "faces");
  const std::vector<geometry::NearestPoint> places = surface.query(nn::points_of<double>(points, "points"));
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
  const geometry::PointIndex tree(nn::points_of<double>(vertices, "vertices"));
  const std::vector<std::size_t> nearest = tree.nearest(nn::points_of<double>(points, "points"));
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

}  // namespace anigen::skin_field
