#include "anigen/io/file_asset.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <string_view>
#include <utility>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/io/gltf/document.h"
#include "anigen/io/gltf/export.h"

namespace anigen::io {

namespace {

void turn_mesh(const Eigen::Matrix3d& rotation, Mesh& mesh) {
  const Eigen::Matrix3f single = rotation.cast<float>();  // its entries are -1, 0 and 1
  const Eigen::Vector3f positive_zero = Eigen::Vector3f::Zero();
  for (Eigen::Vector3f& v : mesh.vertices) v = single * v + positive_zero;
  for (Eigen::Vector3f& normal : mesh.normals) {
    const Eigen::Vector3d turned = rotation * normal.cast<double>();
    const double length = turned.norm();
    normal = length > 1e-12 ? Eigen::Vector3f((turned / length).cast<float>() + positive_zero)
                            : Eigen::Vector3f(Eigen::Vector3f::UnitY());
  }
}

void turn_skeleton(const Eigen::Matrix3d& rotation, Skeleton& skeleton) {
  Eigen::Matrix4d turn = Eigen::Matrix4d::Identity();
  turn.topLeftCorner<3, 3>() = rotation;
  for (Eigen::Matrix4d& bind : skeleton.bind) bind = turn * bind;
  for (std::size_t j = 0; j < skeleton.rest.size(); ++j) {
    Transform& rest = skeleton.rest[j];
    rest.rotation.normalize();
    if (skeleton.parents[j] >= 0) continue;
    rest.translation = rotation * rest.translation;
    rest.rotation = (Eigen::Quaterniond(rotation) * rest.rotation).normalized();
  }
}

/// Turns keys and tangents of a root: a rotation is linear in both.
void turn_channel(const Eigen::Matrix3d& rotation, Channel& channel) {
  if (channel.path == ChannelPath::kScale) return;
  const std::size_t width = channel.path == ChannelPath::kRotation ? 4 : 3;
  for (std::size_t i = 0; i + width <= channel.values.size(); i += width) {
    double* value = channel.values.data() + i;
    if (channel.path == ChannelPath::kTranslation) {
      Eigen::Map<Eigen::Vector3d> v(value);
      v = (rotation * v).eval();
    } else {
      Eigen::Map<Eigen::Vector4d> q(value);
      q = (Eigen::Quaterniond(rotation) * Eigen::Quaterniond(q[3], q[0], q[1], q[2])).coeffs();
    }
  }
}

// Exporters write scales with noise of single precision.
constexpr double kScaleNoise = 1e-5;

/// True where the joint's scale is one positive number and no clip changes it.
bool has_constant_scale(const Asset& asset, std::size_t joint) {
  const Eigen::Vector3d& scale = asset.skeleton.rest[joint].scale;
  const double size = scale.maxCoeff(), noise = kScaleNoise * size;
  if (!(scale.minCoeff() > 0.0) || size - scale.minCoeff() > noise) return false;
  for (const Animation& animation : asset.animations) {
    for (const Channel& channel : animation.channels) {
      if (at(channel.joint) != joint || channel.path != ChannelPath::kScale) continue;
      if (channel.interpolation == Interpolation::kCubicSpline) return false;
      for (const double x : channel.values) {
        if (std::abs(x - size) > noise) return false;
      }
    }
  }
  return true;
}

/// Channels with keys, each property's last one.
std::vector<Animation> file_animations(const std::vector<Animation>& animations) {
  std::vector<Animation> result;
  for (const Animation& animation : animations) {
    std::map<std::pair<int, ChannelPath>, const Channel*> last;
    for (const Channel& channel : animation.channels) {
      if (!channel.times.empty()) last[{channel.joint, channel.path}] = &channel;
    }
    Animation kept{animation.name, {}};
    for (const auto& [property, channel] : last) kept.channels.push_back(*channel);
    if (!kept.channels.empty()) result.push_back(std::move(kept));
  }
  return result;
}

}  // namespace

void turn_rig(const Eigen::Matrix3d& rotation, Skeleton& skeleton, std::vector<Animation>& animations) {
  turn_skeleton(rotation, skeleton);
  for (Animation& animation : animations) {
    for (Channel& channel : animation.channels) {
      if (skeleton.parents[at(channel.joint)] < 0) turn_channel(rotation, channel);
    }
  }
}

void divide_joint_scales(const std::vector<double>& scales, Asset& asset) {
  Skeleton& skeleton = asset.skeleton;
  const auto above = [&](std::size_t j) { return skeleton.parents[j] < 0 ? 1.0 : scales[at(skeleton.parents[j])]; };
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    skeleton.rest[j].translation *= above(j);
    skeleton.rest[j].scale *= above(j) / scales[j];
    skeleton.bind[j].topLeftCorner<3, 3>() /= scales[j];
  }
  for (Animation& animation : asset.animations) {
    for (Channel& channel : animation.channels) {
      if (channel.path == ChannelPath::kRotation) continue;
      const std::size_t joint = at(channel.joint);
      const double factor = above(joint) / (channel.path == ChannelPath::kScale ? scales[joint] : 1.0);
      for (double& x : channel.values) x *= factor;
    }
  }
}

void remove_constant_scales(Asset& asset) {
  const Skeleton& skeleton = asset.skeleton;
  std::vector<double> scales(skeleton.size(), 1.0);  // at and above each joint
  std::vector<char> is_constant(skeleton.size(), 0);
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    is_constant[j] = has_constant_scale(asset, j) ? 1 : 0;
    if (skeleton.parents[j] >= 0) scales[j] = scales[at(skeleton.parents[j])];
    if (is_constant[j] != 0) scales[j] *= skeleton.rest[j].scale.maxCoeff();
  }
  divide_joint_scales(scales, asset);
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    if (is_constant[j] != 0) asset.skeleton.rest[j].scale = Eigen::Vector3d::Ones();  // without the noise
  }
  for (Animation& animation : asset.animations) {
    for (Channel& channel : animation.channels) {
      if (channel.path != ChannelPath::kScale || is_constant[at(channel.joint)] == 0) continue;
      std::set<double> ends{channel.times.front(), channel.times.back()};  // so that the clip keeps its length
      channel.times.assign(ends.begin(), ends.end());
      channel.values.assign(3 * ends.size(), 1.0);
    }
  }
}

void remove_bind_scales(Asset& asset) {
  std::vector<double> scales;
  for (const Eigen::Matrix4d& bind : asset.skeleton.bind)
    scales.push_back(std::cbrt(std::abs(bind.topLeftCorner<3, 3>().determinant())));
  divide_joint_scales(scales, asset);
}

Asset file_asset(const std::string& file, const Asset& asset, const ExportOptions& options) {
  refuse_unsound(file, asset, options);
  const Eigen::Matrix3d rotation = axis_rotation(options.axes);
  Asset result = asset;
  turn_mesh(rotation, result.mesh);
  result.animations = options.animations ? file_animations(asset.animations) : std::vector<Animation>();
  turn_rig(rotation, result.skeleton, result.animations);
  if (result.skin.rows() > 0) result.skin = limit_influences(result.skin, options.influences);
  return result;
}

std::string unused_name(const std::string& wanted, const std::vector<std::string>& taken) {
  std::string name = wanted;
  for (int i = 2; std::find(taken.begin(), taken.end(), name) != taken.end(); ++i)
    name = wanted + "_" + std::to_string(i);
  return name;
}

std::string file_stem(const std::string& name) {
  std::string stem;
  for (const char c : name) {
    const bool plain =
        static_cast<unsigned char>(c) > 0x20 && std::string_view("/\\:*?\"<>|@").find(c) == std::string_view::npos;
    stem += plain ? c : '_';
  }
  constexpr std::size_t kLongest = 100;
  if (stem.size() > kLongest) stem.resize(kLongest);
  if (stem.empty() || stem.front() == '.') stem.insert(0, "_");
  return stem;
}

std::vector<int> used_materials(const Mesh& mesh) {
  if (mesh.faces.empty()) return {};
  if (mesh.face_materials.empty()) return {-1};
  const std::set<int> used(mesh.face_materials.begin(), mesh.face_materials.end());
  return {used.begin(), used.end()};
}

Material material_or_default(const Asset& asset, int material) {
  if (material >= 0) return asset.materials[at(material)];
  Material plain;
  plain.name = "default";
  return plain;
}

const EncodedImage* image_of(const Asset& asset, const Material& material) {
  return material.image < 0 || asset.mesh.uvs.empty() ? nullptr : &asset.images[at(material.image)];
}

std::string image_extension(const EncodedImage& image, const std::string& file) {
  const char* type =
      gltf_import::picture_mime_type({reinterpret_cast<const char*>(image.bytes.data()), image.bytes.size()});
  if (type == nullptr) throw InputError(file, "", "image '" + image.name + "' of the asset is neither PNG nor JPEG");
  return std::string_view(type) == "image/png" ? ".png" : ".jpg";
}

}  // namespace anigen::io
