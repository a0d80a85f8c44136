#include "anigen/generate/assemble.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/skeleton.h"
#include "anigen/asset/skin_weights.h"
#include "anigen/core/error.h"
#include "anigen/io/gltf/export.h"
#include "anigen/io/gltf/gltf.h"
#include "anigen/io/ply.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/nn/init.h"
#include "anigen/render/picture.h"
#include "anigen/render/scene.h"
#include "anigen/render/visibility.h"
#include "anigen/skeleton_field/skeleton_repair.h"

namespace anigen::generate {

namespace {

using torch::Tensor;

std::string indexed(const char* array, std::int64_t index) {
  return std::string(array) + "[" + std::to_string(index) + "]";
}

/// On the CPU, contiguous. @throws InputError unless it has `columns` columns and, where not -1, `rows` rows
Tensor checked_rows(const Tensor& tensor, std::int64_t rows, std::int64_t columns, torch::Dtype dtype,
                    const char* name) {
  const bool fits = tensor.defined() && tensor.dim() == 2 && (rows < 0 || tensor.size(0) == rows) &&
                    (columns < 0 || tensor.size(1) == columns);
  if (!fits) throw InputError("", name, "decoded tensor has an unexpected shape: " + nn::shape_text(tensor));
  return tensor.detach().to(torch::kCPU, dtype).contiguous();
}

std::vector<Eigen::Vector3f> checked_points(const Tensor& tensor, const char* name) {
  const Tensor values = checked_rows(tensor, -1, 3, torch::kFloat32, name);
  const float* next = values.data_ptr<float>();
  std::vector<Eigen::Vector3f> points(static_cast<std::size_t>(values.size(0)));
  for (std::size_t i = 0; i < points.size(); ++i, next += 3) {
    points[i] = Eigen::Vector3f(next[0], next[1], next[2]);
    if (!points[i].allFinite()) throw InputError("", indexed(name, static_cast<std::int64_t>(i)), "not finite");
  }
  return points;
}

std::vector<Triangle> checked_faces(const Tensor& tensor, std::size_t vertices) {
  const Tensor values = checked_rows(tensor, -1, 3, torch::kInt64, "faces");
  const std::int64_t* next = values.data_ptr<std::int64_t>();
  const auto count = static_cast<std::int64_t>(vertices);
  std::vector<Triangle> faces(static_cast<std::size_t>(values.size(0)));
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (std::int32_t& corner : faces[f]) {
      const std::int64_t vertex = *next++;
      if (vertex < 0 || vertex >= count) {
        throw InputError("", indexed("faces", static_cast<std::int64_t>(f)),
                         "refers to vertex " + std::to_string(vertex) + " of " + std::to_string(count));
      }
      corner = static_cast<std::int32_t>(vertex);
    }
  }
  return faces;
}

/// The first three attributes, from sRGB to linear. @return empty without colour
std::vector<Eigen::Vector4f> linear_colors(const Tensor& attributes, std::size_t vertices) {
  if (!attributes.defined()) return {};
  const Tensor values =
      checked_rows(attributes, static_cast<std::int64_t>(vertices), -1, torch::kFloat32, "attributes");
  const std::int64_t width = values.size(1);
  if (width < 3) throw InputError("", "attributes", "decoded attributes have no colour: " + nn::shape_text(values));
  const float* next = values.data_ptr<float>();
  std::vector<Eigen::Vector4f> colors(vertices, Eigen::Vector4f::Ones());
  for (std::size_t v = 0; v < vertices; ++v, next += width) {
    for (int k = 0; k < 3; ++k) {
      if (!std::isfinite(next[k]))
        throw InputError("", indexed("attributes", static_cast<std::int64_t>(v)), "a colour is not finite");
      colors[v][k] = render::srgb_to_linear(std::clamp(next[k], 0.0F, 1.0F));
    }
  }
  return colors;
}

Mesh mesh_of(const shape_field::ExtractedMesh& decoded) {
  Mesh mesh;
  if (!decoded.vertices.defined() || decoded.vertices.numel() == 0 || !decoded.faces.defined() ||
      decoded.faces.numel() == 0) {
    throw InputError("", "", "the decoded asset has no surface");
  }
  mesh.vertices = checked_points(decoded.vertices, "vertices");
  if (mesh.vertices.size() > static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max()))
    throw InputError("", "vertices", "more than 2^31 - 1");
  mesh.faces = checked_faces(decoded.faces, mesh.vertices.size());
  mesh.normals = vertex_normals(mesh.vertices, mesh.faces);
  mesh.colors = linear_colors(decoded.attributes, mesh.vertices.size());
  return mesh;
}

struct OrderedSkeleton {
  Skeleton skeleton;
  std::vector<std::int32_t> new_index;  ///< by decoded joint
};

OrderedSkeleton skeleton_of(const skeleton_field::SkeletonTensors& decoded) {
  const std::vector<Eigen::Vector3f> joints = checked_points(decoded.joints, "joints");
  if (joints.empty()) throw InputError("", "joints", "the decoded skeleton has no joints");
  const auto count = static_cast<std::int64_t>(joints.size());
  if (!decoded.parents.defined() || decoded.parents.dim() != 1 || decoded.parents.size(0) != count) {
    throw InputError("", "parents",
                     std::to_string(count) + " joints, but parents of shape " + nn::shape_text(decoded.parents));
  }
  const Tensor values = decoded.parents.to(torch::kCPU, torch::kInt64).clamp(-1, count).to(torch::kInt32).contiguous();
  const std::vector<int> parents(values.data_ptr<std::int32_t>(), values.data_ptr<std::int32_t>() + count);
  const skeleton_field::RootedTree tree =
      skeleton_field::one_rooted_tree(joints, skeleton_field::repair_parents_as_published(joints, parents));
  OrderedSkeleton ordered;
  ordered.new_index.resize(joints.size());
  std::vector<Eigen::Vector3d> positions;
  for (std::size_t j = 0; j < tree.order.size(); ++j) {
    const auto old = static_cast<std::size_t>(tree.order[j]);
    ordered.new_index[old] = static_cast<std::int32_t>(j);
    positions.emplace_back(joints[old].cast<double>());
  }
  ordered.skeleton = io::unrotated_in_file(
      skeleton_from_joints(positions, tree.parents, joint_names(positions, tree.parents)), io::ExportAxes::kGltf);
  return ordered;
}

/// Appends the row of one vertex, without its light influences.
void append_influences(const float* weights, std::int64_t vertex, const std::vector<std::int32_t>& new_index,
                       float least_weight, SkinWeights& skin) {
  std::vector<Influence> row;
  std::size_t heaviest = 0;
  for (std::size_t j = 0; j < new_index.size(); ++j) {
    if (!std::isfinite(weights[j])) throw InputError("", indexed("weights", vertex), "a skin weight is not finite");
    if (weights[j] > weights[heaviest]) heaviest = j;
    if (weights[j] >= least_weight && weights[j] > 0.0F) row.push_back({new_index[j], weights[j]});
  }
  if (row.empty() && weights[heaviest] > 0.0F) row.push_back({new_index[heaviest], 1.0F});
  if (!skin.append_row(std::move(row))) throw InputError("", indexed("weights", vertex), "no skin weight is positive");
}

SkinWeights skin_of(const SkinWeightRows& weights, std::int64_t vertices, const std::vector<std::int32_t>& new_index,
                    const DecodedAssetOptions& options) {
  SkinWeights skin;
  const auto joints = static_cast<std::int64_t>(new_index.size());
  for (std::int64_t begin = 0; begin < vertices; begin += options.chunk) {
    const std::int64_t end = std::min(vertices, begin + options.chunk);
    const Tensor rows = checked_rows(weights(begin, end), end - begin, joints, torch::kFloat32, "weights");
    const float* next = rows.data_ptr<float>();
    for (std::int64_t v = begin; v < end; ++v, next += joints)
      append_influences(next, v, new_index, options.least_weight, skin);
  }
  return skin;
}

Eigen::Vector4f confidence_color(float confidence) {
  const Eigen::Vector3f srgb = render::heat_color(confidence);
  return {render::srgb_to_linear(srgb.x()), render::srgb_to_linear(srgb.y()), render::srgb_to_linear(srgb.z()), 1.0F};
}

/// Corners 2 a and 2 a + 1 lie on the positive and negative side of axis a.
void append_octahedron(const Eigen::Vector3f& center, const Eigen::Vector4f& color, float radius, Mesh& mesh) {
  const auto first = static_cast<std::int32_t>(mesh.vertices.size());
  for (int corner = 0; corner < 6; ++corner) {
    Eigen::Vector3f direction = Eigen::Vector3f::Zero();
    direction[corner / 2] = corner % 2 == 0 ? 1.0F : -1.0F;
    mesh.vertices.emplace_back(center + radius * direction);
    mesh.normals.push_back(direction);
    mesh.colors.push_back(color);
  }
  for (std::int32_t octant = 0; octant < 8; ++octant) {
    const std::int32_t x = octant & 1, y = octant >> 1 & 1, z = octant >> 2 & 1;  // 1: the negative side
    const std::int32_t a = first + x, b = first + 2 + y, c = first + 4 + z;
    // Each negative side mirrors the triangle once.
    mesh.faces.push_back((x + y + z) % 2 == 0 ? Triangle{a, b, c} : Triangle{a, c, b});
  }
}

}  // namespace

Skeleton decoded_skeleton(const skeleton_field::SkeletonTensors& skeleton) { return skeleton_of(skeleton).skeleton; }

Asset decoded_shape(const shape_field::ExtractedMesh& mesh, const std::string& name) {
  Asset asset;
  asset.name = name;
  asset.mesh = mesh_of(mesh);
  bind_rigidly(asset, "root");
  asset.skeleton = io::unrotated_in_file(asset.skeleton, io::ExportAxes::kGltf);
  return asset;
}

Asset decoded_asset(const shape_field::ExtractedMesh& mesh, const skeleton_field::SkeletonTensors& skeleton,
                    const SkinWeightRows& weights, const DecodedAssetOptions& options) {
  if (options.chunk < 1) throw InputError("", "chunk", "must be at least 1");
  Asset asset;
  asset.name = options.name;
  asset.mesh = mesh_of(mesh);
  OrderedSkeleton ordered = skeleton_of(skeleton);
  asset.skeleton = std::move(ordered.skeleton);
  asset.skin = skin_of(weights, static_cast<std::int64_t>(asset.mesh.vertices.size()), ordered.new_index, options);
  return asset;
}

Asset decoded_asset(const shape_field::ExtractedMesh& mesh, const skeleton_field::SkeletonTensors& skeleton,
                    const Tensor& weights, const DecodedAssetOptions& options) {
  const bool has_surface = mesh.vertices.defined() && mesh.vertices.dim() == 2;
  if (!weights.defined() || weights.dim() != 2 || (has_surface && weights.size(0) != mesh.vertices.size(0)))
    throw InputError("", "weights", "expected a row per vertex, got " + nn::shape_text(weights));
  const SkinWeightRows rows = [&](std::int64_t begin, std::int64_t end) { return weights.slice(0, begin, end); };
  return decoded_asset(mesh, skeleton, rows, options);
}

Mesh votes_cloud(const skeleton_field::SkeletonField& field, const VotesCloudOptions& options) {
  const skeleton_field::Votes votes = skeleton_field::votes_of(field);
  const bool joints = options.shown == VotesShown::kJoints;
  const std::vector<Eigen::Vector3f>& positions = joints ? votes.joints : votes.parents;
  const std::vector<float>& confidences = joints ? votes.joint_confidence : votes.parent_confidence;
  Mesh cloud;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const float confidence = confidences.empty() ? 1.0F : confidences[i];
    if (!positions[i].allFinite() || !std::isfinite(confidence)) {
      throw InputError("", indexed(joints ? "joints" : "parents", static_cast<std::int64_t>(i)),
                       "the vote or its confidence is not finite");
    }
    if (confidence < options.least_confidence) continue;
    cloud.vertices.push_back(positions[i]);
    cloud.colors.push_back(confidence_color(confidence));
  }
  return cloud;
}

Asset votes_asset(const skeleton_field::SkeletonField& field, const VotesCloudOptions& options) {
  if (!(options.radius > 0.0F) || !std::isfinite(options.radius)) throw InputError("", "radius", "must be positive");
  const Mesh cloud = votes_cloud(field, options);
  Asset asset;
  asset.name = options.shown == VotesShown::kJoints ? "joint votes" : "parent votes";
  for (std::size_t i = 0; i < cloud.vertices.size(); ++i)
    append_octahedron(cloud.vertices[i], cloud.colors[i], options.radius, asset.mesh);
  bind_rigidly(asset, "votes");
  asset.skeleton = io::unrotated_in_file(asset.skeleton, io::ExportAxes::kGltf);
  return asset;
}

void write_votes(const std::filesystem::path& path, const skeleton_field::SkeletonField& field,
                 const VotesCloudOptions& options) {
  const std::string extension = io::lower_extension(path);
  if (extension == ".glb" || extension == ".gltf") {
    const Asset asset = votes_asset(field, options);
    if (asset.mesh.vertices.empty()) throw InputError(path.string(), "", "there is no vote to show");
    io::write_gltf(path, asset);
  } else if (extension == ".ply") {
    Mesh cloud = votes_cloud(field, options);
    if (cloud.vertices.empty()) throw InputError(path.string(), "", "there is no vote to show");
    for (Eigen::Vector4f& color : cloud.colors) {
      for (int k = 0; k < 3; ++k) color[k] = render::linear_to_srgb(color[k]);
    }
    io::write_ply(path, cloud);
  } else {
    throw InputError(path.string(), "", "votes are written as .ply, .glb or .gltf");
  }
}

}  // namespace anigen::generate
