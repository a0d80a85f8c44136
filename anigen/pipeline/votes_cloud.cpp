#include "anigen/pipeline/votes_cloud.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "anigen/asset/rigid_asset.h"
#include "anigen/core/error.h"
#include "anigen/io/gltf.h"
#include "anigen/io/ply.h"
#include "anigen/raytrace/palette.h"
#include "anigen/raytrace/srgb.h"

namespace anigen::pipeline {
namespace {

Eigen::Vector4f confidence_color(float confidence) {
  const Eigen::Vector3f srgb = raytrace::heat_color(confidence);
  return {raytrace::srgb_to_linear(srgb.x()), raytrace::srgb_to_linear(srgb.y()), raytrace::srgb_to_linear(srgb.z()),
          1.0F};
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

std::string lower_case_extension(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return extension;
}

}  // namespace

Mesh votes_cloud(const fields::SkeletonField& field, const VotesCloudOptions& options) {
  const geometry::Votes votes = fields::votes_of(field);
  const bool joints = options.shown == VotesShown::kJoints;
  const std::vector<Eigen::Vector3f>& positions = joints ? votes.joints : votes.parents;
  const std::vector<float>& confidences = joints ? votes.joint_confidence : votes.parent_confidence;
  Mesh cloud;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const float confidence = confidences.empty() ? 1.0F : confidences[i];
    if (!positions[i].allFinite() || !std::isfinite(confidence)) {
      throw InputError("", std::string(joints ? "joints[" : "parents[") + std::to_string(i) + "]",
                       "the vote or its confidence is not finite");
    }
    if (confidence < options.least_confidence) continue;
    cloud.vertices.push_back(positions[i]);
    cloud.colors.push_back(confidence_color(confidence));
  }
  return cloud;
}

Asset votes_asset(const fields::SkeletonField& field, const VotesCloudOptions& options) {
  if (!(options.radius > 0.0F) || !std::isfinite(options.radius)) {
    throw InputError("", "radius", "must be positive");
  }
  const Mesh cloud = votes_cloud(field, options);
  Asset asset;
  asset.name = options.shown == VotesShown::kJoints ? "joint votes" : "parent votes";
  for (std::size_t i = 0; i < cloud.vertices.size(); ++i) {
    append_octahedron(cloud.vertices[i], cloud.colors[i], options.radius, asset.mesh);
  }
  bind_rigidly(asset, "votes");
  return asset;
}

void write_votes(const std::filesystem::path& path, const fields::SkeletonField& field,
                 const VotesCloudOptions& options) {
  const std::string extension = lower_case_extension(path);
  if (extension == ".glb" || extension == ".gltf") {
    const Asset asset = votes_asset(field, options);
    if (asset.mesh.vertices.empty()) throw InputError(path.string(), "", "there is no vote to show");
    io::write_gltf(path, asset);
  } else if (extension == ".ply") {
    Mesh cloud = votes_cloud(field, options);
    if (cloud.vertices.empty()) throw InputError(path.string(), "", "there is no vote to show");
    for (Eigen::Vector4f& color : cloud.colors) {
      for (int k = 0; k < 3; ++k) color[k] = raytrace::linear_to_srgb(color[k]);
    }
    io::write_ply(path, cloud);
  } else {
    throw InputError(path.string(), "", "votes are written as .ply, .glb or .gltf");
  }
}

}  // namespace anigen::pipeline
