#include "tests/io/gltf/gltf_import_reference.h"

#include <tiny_gltf.h>

#include <Eigen/Geometry>
#include <cmath>
#include <set>
#include <stdexcept>

namespace anigen::test {
namespace {

using Eigen::Matrix4d;
using Numbers = std::vector<double>;

std::size_t at(int index) { return static_cast<std::size_t>(index); }

template <typename T>
double load(const unsigned char* source) {
  T value;
  std::memcpy(&value, source, sizeof value);
  return static_cast<double>(value);
}

double component(const unsigned char* source, int type, bool normalized) {
  switch (type) {
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
      return load<std::uint8_t>(source) / (normalized ? 255.0 : 1.0);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
      return load<std::uint16_t>(source) / (normalized ? 65535.0 : 1.0);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
      return load<std::uint32_t>(source);
    case TINYGLTF_COMPONENT_TYPE_FLOAT:
      return load<float>(source);
    default:
      throw std::runtime_error("the reference reader does not know this component type");
  }
}

Numbers numbers(const tinygltf::Model& model, int index) {
  const tinygltf::Accessor& accessor = model.accessors[at(index)];
  if (accessor.sparse.isSparse || accessor.bufferView < 0) throw std::runtime_error("sparse accessor");
  const tinygltf::BufferView& view = model.bufferViews[at(accessor.bufferView)];
  const unsigned char* data = model.buffers[at(view.buffer)].data.data() + view.byteOffset + accessor.byteOffset;
  const std::size_t width = at(tinygltf::GetNumComponentsInType(static_cast<std::uint32_t>(accessor.type)));
  const std::size_t size = at(tinygltf::GetComponentSizeInBytes(static_cast<std::uint32_t>(accessor.componentType)));
  Numbers result;
  for (std::size_t i = 0; i < accessor.count; ++i) {
    for (std::size_t c = 0; c < width; ++c) {
      const unsigned char* source = data + i * at(accessor.ByteStride(view)) + c * size;
      result.push_back(component(source, accessor.componentType, accessor.normalized));
    }
  }
  return result;
}

struct Pose {
  Eigen::Vector3d t = Eigen::Vector3d::Zero(), s = Eigen::Vector3d::Ones();
  Eigen::Vector4d q{0, 0, 0, 1};
  bool has_matrix = false;
  Matrix4d m = Matrix4d::Identity();

  explicit Pose(const tinygltf::Node& node) {
    if (!node.matrix.empty()) {
      has_matrix = true;
      m = Eigen::Map<const Matrix4d>(node.matrix.data());
    }
    if (!node.translation.empty()) t = Eigen::Map<const Eigen::Vector3d>(node.translation.data());
    if (!node.scale.empty()) s = Eigen::Map<const Eigen::Vector3d>(node.scale.data());
    if (!node.rotation.empty()) q = Eigen::Map<const Eigen::Vector4d>(node.rotation.data());
  }
  Matrix4d matrix() const {
    if (has_matrix) return m;
    Eigen::Affine3d affine =
        Eigen::Translation3d(t) * Eigen::Quaterniond(q[3], q[0], q[1], q[2]).normalized() * Eigen::Scaling(s);
    return affine.matrix();
  }
};

// Appendix C of glTF 2.0, straightforwardly.
Eigen::Vector4d sample(const Numbers& times, const Numbers& values, std::size_t width, const std::string& kind,
                       bool rotation, double time) {
  const bool cubic = kind == "CUBICSPLINE";
  const auto value = [&](std::size_t key, std::size_t part) {
    Eigen::Vector4d v = Eigen::Vector4d::Zero();
    for (std::size_t c = 0; c < width; ++c)
      v[static_cast<Eigen::Index>(c)] = values[(cubic ? 3 * key + part : key) * width + c];
    return v;
  };
  if (time <= times.front()) return value(0, 1);
  if (time >= times.back()) return value(times.size() - 1, 1);
  std::size_t k = 0;
  while (times[k + 1] <= time) ++k;
  const double span = times[k + 1] - times[k], u = (time - times[k]) / span;
  const Eigen::Vector4d a = value(k, 1), b = value(k + 1, 1);
  if (kind == "STEP") return a;
  if (cubic) {
    return (2 * u * u * u - 3 * u * u + 1) * a + span * (u * u * u - 2 * u * u + u) * value(k, 2) +
           (3 * u * u - 2 * u * u * u) * b + span * (u * u * u - u * u) * value(k + 1, 0);
  }
  if (!rotation) return (1 - u) * a + u * b;
  const Eigen::Quaterniond qa(a[3], a[0], a[1], a[2]), qb(b[3], b[0], b[1], b[2]);
  return qa.normalized().slerp(u, qb.normalized()).coeffs();
}

}  // namespace

struct GltfReference::Model {
  tinygltf::Model gltf;
  std::vector<int> parents;
  std::set<int> shown;

  std::vector<Matrix4d> worlds(int animation, double time) const;
};

std::vector<Matrix4d> GltfReference::Model::worlds(int animation, double time) const {
  std::vector<Pose> poses;
  for (const tinygltf::Node& node : gltf.nodes) poses.emplace_back(node);
  if (animation >= 0) {
    const tinygltf::Animation& source = gltf.animations[at(animation)];
    for (const tinygltf::AnimationChannel& channel : source.channels) {
      if (channel.target_node < 0 || channel.target_path == "weights") continue;
      const tinygltf::AnimationSampler& sampler = source.samplers[at(channel.sampler)];
      const bool rotation = channel.target_path == "rotation";
      const Eigen::Vector4d v = sample(numbers(gltf, sampler.input), numbers(gltf, sampler.output), rotation ? 4 : 3,
                                       sampler.interpolation, rotation, time);
      Pose& pose = poses[at(channel.target_node)];
      if (rotation)
        pose.q = v;
      else
        (channel.target_path == "scale" ? pose.s : pose.t) = v.head<3>();
    }
  }
  std::vector<Matrix4d> result;
  for (std::size_t n = 0; n < poses.size(); ++n) {
    Matrix4d world = poses[n].matrix();
    for (int p = parents[n]; p >= 0; p = parents[at(p)]) world = poses[at(p)].matrix() * world;
    result.push_back(world);
  }
  return result;
}

GltfReference::GltfReference(const std::filesystem::path& path) : model_(new Model) {
  tinygltf::TinyGLTF loader;
  loader.SetImageLoader([](tinygltf::Image*, const int, std::string*, std::string*, int, int, const unsigned char*, int,
                           void*) { return true; },
                        nullptr);
  std::string error, warning;
  const bool ok = path.extension() == ".glb" ? loader.LoadBinaryFromFile(&model_->gltf, &error, &warning, path.string())
                                             : loader.LoadASCIIFromFile(&model_->gltf, &error, &warning, path.string());
  if (!ok) {
    delete model_;
    throw std::runtime_error(error);
  }
  const tinygltf::Model& gltf = model_->gltf;
  model_->parents.assign(gltf.nodes.size(), -1);
  for (std::size_t n = 0; n < gltf.nodes.size(); ++n) {
    for (const int child : gltf.nodes[n].children) model_->parents[at(child)] = static_cast<int>(n);
  }
  std::vector<int> stack = gltf.scenes[at(std::max(gltf.defaultScene, 0))].nodes;
  while (!stack.empty()) {
    const int n = stack.back();
    stack.pop_back();
    model_->shown.insert(n);
    stack.insert(stack.end(), gltf.nodes[at(n)].children.begin(), gltf.nodes[at(n)].children.end());
  }
}

GltfReference::~GltfReference() { delete model_; }

std::size_t GltfReference::animations() const { return model_->gltf.animations.size(); }

double GltfReference::duration(std::size_t animation) const {
  double last = 0.0;
  for (const tinygltf::AnimationSampler& sampler : model_->gltf.animations[animation].samplers)
    last = std::max(last, numbers(model_->gltf, sampler.input).back());
  return last;
}

std::vector<bool> GltfReference::follows_no_joint() const {
  const tinygltf::Model& gltf = model_->gltf;
  std::set<int> joints;
  for (const tinygltf::Skin& skin : gltf.skins) joints.insert(skin.joints.begin(), skin.joints.end());
  std::vector<bool> result;
  for (std::size_t m = 0; m < gltf.meshes.size(); ++m) {
    std::set<std::map<std::string, int>> seen;
    for (const tinygltf::Primitive& primitive : gltf.meshes[m].primitives) {
      if (!seen.insert(primitive.attributes).second) continue;
      for (const int n : model_->shown) {
        if (gltf.nodes[at(n)].mesh != static_cast<int>(m)) continue;
        bool is_free = gltf.nodes[at(n)].skin < 0;
        for (int p = n; p >= 0; p = model_->parents[at(p)]) is_free = is_free && joints.count(p) == 0;
        result.insert(result.end(), gltf.accessors[at(primitive.attributes.at("POSITION"))].count, is_free);
      }
    }
  }
  return result;
}

std::vector<Eigen::Vector3f> GltfReference::vertices(int animation, double time) const {
  const tinygltf::Model& gltf = model_->gltf;
  const std::vector<Matrix4d> world = model_->worlds(animation, time);
  std::vector<Eigen::Vector3f> result;
  const auto add = [&](const Eigen::Vector4d& p) {
    result.emplace_back(static_cast<float>(p.x()), static_cast<float>(-p.z()), static_cast<float>(p.y()));
  };
  for (std::size_t m = 0; m < gltf.meshes.size(); ++m) {
    std::set<std::map<std::string, int>> seen;
    for (const tinygltf::Primitive& primitive : gltf.meshes[m].primitives) {
      if (!seen.insert(primitive.attributes).second) continue;
      const Numbers positions = numbers(gltf, primitive.attributes.at("POSITION"));
      std::vector<std::pair<Numbers, Numbers>> sets;
      for (int k = 0; primitive.attributes.count("JOINTS_" + std::to_string(k)) != 0; ++k) {
        sets.emplace_back(numbers(gltf, primitive.attributes.at("JOINTS_" + std::to_string(k))),
                          numbers(gltf, primitive.attributes.at("WEIGHTS_" + std::to_string(k))));
      }
      for (const int n : model_->shown) {
        const tinygltf::Node& node = gltf.nodes[at(n)];
        if (node.mesh != static_cast<int>(m)) continue;
        Numbers inverse;
        if (node.skin >= 0 && gltf.skins[at(node.skin)].inverseBindMatrices >= 0)
          inverse = numbers(gltf, gltf.skins[at(node.skin)].inverseBindMatrices);
        for (std::size_t v = 0; v < positions.size() / 3; ++v) {
          const Eigen::Vector4d p(positions[3 * v], positions[3 * v + 1], positions[3 * v + 2], 1.0);
          if (node.skin < 0 || sets.empty()) {
            add(world[at(n)] * p);
            continue;
          }
          Eigen::Vector4d blended = Eigen::Vector4d::Zero();
          double sum = 0.0;
          for (const auto& [joints, weights] : sets) {
            for (std::size_t k = 4 * v; k < 4 * v + 4; ++k) {
              sum += weights[k];
              if (weights[k] == 0.0) continue;
              const auto joint = static_cast<std::size_t>(joints[k]);
              Matrix4d bind = Matrix4d::Identity();
              if (!inverse.empty()) bind = Eigen::Map<const Matrix4d>(inverse.data() + 16 * joint);
              blended += weights[k] * (world[at(gltf.skins[at(node.skin)].joints[joint])] * bind * p);
            }
          }
          // As good as no weight: the importer's choice, not the formula's.
          add(sum > 1e-6 ? Eigen::Vector4d(blended / sum) : Eigen::Vector4d::Constant(NAN));
        }
      }
    }
  }
  return result;
}

std::size_t GltfReference::triangles() const {
  const tinygltf::Model& gltf = model_->gltf;
  std::size_t count = 0;
  for (const int n : model_->shown) {
    if (gltf.nodes[at(n)].mesh < 0) continue;
    for (const tinygltf::Primitive& primitive : gltf.meshes[at(gltf.nodes[at(n)].mesh)].primitives) {
      Numbers indices;
      if (primitive.indices >= 0) indices = numbers(gltf, primitive.indices);
      const std::size_t size =
          primitive.indices >= 0 ? indices.size() : gltf.accessors[at(primitive.attributes.at("POSITION"))].count;
      for (std::size_t i = 0; i + 3 <= size; i += 3) {
        const bool repeats = !indices.empty() && (indices[i] == indices[i + 1] || indices[i + 1] == indices[i + 2] ||
                                                  indices[i + 2] == indices[i]);
        count += repeats ? 0 : 1;
      }
    }
  }
  return count;
}

}  // namespace anigen::test
