#include "tests/io/small_asset.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "anigen/io/image.h"

namespace anigen::test {
namespace {

void add_mesh(Asset& asset, std::size_t segments) {
  Mesh& mesh = asset.mesh;
  for (std::size_t i = 0; i <= segments; ++i) {
    const float z = static_cast<float>(i) / static_cast<float>(segments) - 0.5f;
    for (const float x : {-0.1f, 0.1f}) {
      mesh.vertices.emplace_back(x, 0.05f * z, z);
      mesh.normals.push_back(Eigen::Vector3f(x, -1.0f, 0.3f * z).normalized());
      mesh.uvs.emplace_back(x + 0.5f, 0.5f - z);
      mesh.colors.emplace_back(x + 0.5f, 0.25f, z + 0.5f, 1.0f);
    }
  }
  for (std::size_t i = 0; i < segments; ++i) {
    const auto v = static_cast<std::int32_t>(2 * i);
    mesh.faces.push_back({v, v + 1, v + 3});
    mesh.faces.push_back({v, v + 3, v + 2});
  }
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) mesh.face_materials.push_back(f < 2 ? 0 : 1);
}

void add_skeleton(Asset& asset, std::size_t joints) {
  Skeleton& skeleton = asset.skeleton;
  Eigen::Matrix4d world = Eigen::Matrix4d::Identity();
  world.topRightCorner<3, 1>() = Eigen::Vector3d(0.01, 0.02, -0.5);
  for (std::size_t j = 0; j < joints; ++j) {
    Transform local;
    if (j > 0) local.translation = Eigen::Vector3d(0, 0, 1.0 / static_cast<double>(joints));
    local.rotation = Eigen::AngleAxisd(0.1, Eigen::Vector3d::UnitY());
    world = j == 0 ? Eigen::Matrix4d(world * local.matrix()) : Eigen::Matrix4d(skeleton.bind[j - 1] * local.matrix());
    skeleton.names.push_back("joint_" + std::to_string(j));
    skeleton.parents.push_back(static_cast<int>(j) - 1);
    skeleton.bind.push_back(world);
    if (j == 0) {
      local = decompose(world);
    } else {
      local.rotation = local.rotation * Eigen::AngleAxisd(0.05, Eigen::Vector3d::UnitX());
      local.scale = Eigen::Vector3d(1.0, 1.0, 1.25);
    }
    skeleton.rest.push_back(local);
  }
}

void add_weights(Asset& asset, std::size_t influences) {
  const auto joints = static_cast<double>(asset.skeleton.size());
  for (const Eigen::Vector3f& v : asset.mesh.vertices) {
    const auto centre = static_cast<std::size_t>(std::clamp((v.z() + 0.5) * joints, 0.0, joints - 1.0));
    std::vector<Influence> row;
    for (std::size_t i = 0; i < influences; ++i) {
      const auto joint = static_cast<std::int32_t>((centre + i) % asset.skeleton.size());
      row.push_back({joint, 1.0f / static_cast<float>(i + 1)});
    }
    asset.skin.append_row(row);
  }
}

void add_animation(Asset& asset) {
  Animation animation;
  animation.name = "wave";
  Channel turn{0, ChannelPath::kRotation, Interpolation::kLinear, {0.0, 0.5, 1.0}, {}};
  for (const double angle : {0.0, 0.4, -0.3}) {
    const Eigen::Quaterniond q(Eigen::AngleAxisd(angle, Eigen::Vector3d(1, 2, 3).normalized()));
    turn.values.insert(turn.values.end(), {q.x(), q.y(), q.z(), q.w()});
  }
  const auto last = static_cast<int>(asset.skeleton.size()) - 1;
  Channel grow{last, ChannelPath::kScale, Interpolation::kStep, {0.25, 0.75}, {1, 1, 1, 2, 1, 0.5}};
  Channel move{0, ChannelPath::kTranslation, Interpolation::kCubicSpline, {0.0, 1.0}, {}};
  move.values = {0, 0, 0, 0.01, 0.02, -0.5, 0.1, 0.2, 0.3, -0.1, 0, 0.4, 0.3, 0.2, 0.1, 0, 0, 0};
  animation.channels = {turn, grow, move};
  asset.animations.push_back(animation);
}

}  // namespace

std::vector<std::uint8_t> tiny_png() {
  io::Image image(2, 2);
  const std::uint8_t colors[4][3] = {{255, 0, 0}, {0, 255, 0}, {0, 0, 255}, {255, 255, 255}};
  for (int i = 0; i < 4; ++i) std::copy_n(colors[i], 3, image.pixel(i % 2, i / 2));
  return io::encode_png(image);
}

EncodedImage tiny_texture() { return {"paint", "image/png", tiny_png()}; }

Asset small_asset(std::size_t joints, std::size_t segments, std::size_t influences) {
  Asset asset;
  asset.name = "strip";
  add_mesh(asset, segments);
  add_skeleton(asset, joints);
  add_weights(asset, influences);
  asset.materials = {{"skin", {0.8f, 0.6f, 0.4f, 1.0f}, -1, true}, {"cloth", {1.0f, 1.0f, 1.0f, 1.0f}, 0, false}};
  asset.images = {tiny_texture()};
  add_animation(asset);
  return asset;
}

}  // namespace anigen::test
