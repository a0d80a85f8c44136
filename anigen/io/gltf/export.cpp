#include "anigen/io/gltf/export.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/hash.h"
#include "anigen/core/numeric.h"
#include "anigen/core/text.h"
#include "anigen/core/version.h"
#include "anigen/io/gltf/document.h"

namespace anigen::io {

Eigen::Matrix3d axis_rotation(ExportAxes axes) {
  const double sign = axes == ExportAxes::kPublished ? -1 : 1;
  Eigen::Matrix3d rotation;
  rotation << sign, 0, 0, 0, 0, 1, 0, -sign, 0;
  return rotation;
}

Eigen::Quaterniond axis_quaternion(ExportAxes axes) { return Eigen::Quaterniond(axis_rotation(axes)).normalized(); }

Skeleton unrotated_in_file(const Skeleton& skeleton, ExportAxes axes) {
  Skeleton result = skeleton;
  for (Eigen::Matrix4d& bind : result.bind) bind.topLeftCorner<3, 3>() = axis_rotation(axes).transpose();
  // By hand, where bind_pose() would leave the rounding of a decomposition in rotations that are none.
  const std::vector<Eigen::Vector3d> places = result.positions();
  result.rest.assign(places.size(), {});
  for (std::size_t j = 0; j < places.size(); ++j) {
    const int parent = result.parents[j];
    if (parent < 0) {
      result.rest[j].translation = places[j];
      result.rest[j].rotation = axis_quaternion(axes).conjugate();
    } else {
      result.rest[j].translation = axis_rotation(axes) * (places[j] - places[at(parent)]);
    }
  }
  return result;
}

namespace {

constexpr std::size_t kSetSize = 4;

// The row's weights in single precision with a sum as close to 1 as Khronos' validator demands (2e-7 per influence).
// A row that is close enough stays as it is, so that reading the file back gives the same numbers; otherwise the
// heaviest takes the rounding of the others.
std::vector<float> weights_of_row(const SkinWeights& skin, std::size_t v) {
  const Influence* row = skin.row(v);
  const std::size_t n = skin.row_size(v);
  std::vector<float> weights(n);
  double sum = 0.0;
  for (std::size_t i = 0; i < n; ++i) sum += static_cast<double>(weights[i] = row[i].weight);
  if (std::abs(sum - 1.0) <= 1e-7 * static_cast<double>(n)) return weights;
  double others = 0.0;
  for (std::size_t i = 1; i < n; ++i) {
    weights[i] = static_cast<float>(static_cast<double>(row[i].weight) / sum);
    others += static_cast<double>(weights[i]);
  }
  weights[0] = static_cast<float>(1.0 - others);
  return weights;
}

}  // namespace

std::vector<gltf_import::InfluenceSet> influence_sets(const SkinWeights& skin, std::size_t influences) {
  const SkinWeights limited = limit_influences(skin, influences);
  const std::size_t count = std::max<std::size_t>(1, (limited.largest_row() + kSetSize - 1) / kSetSize);
  const std::size_t slots = kSetSize * limited.rows();
  std::vector<gltf_import::InfluenceSet> sets(count,
                                              {std::vector<std::uint32_t>(slots, 0), std::vector<float>(slots, 0.0f)});
  for (std::size_t v = 0; v < limited.rows(); ++v) {
    const std::vector<float> weights = weights_of_row(limited, v);
    for (std::size_t i = 0; i < weights.size(); ++i) {
      gltf_import::InfluenceSet& set = sets[i / kSetSize];
      set.joints[kSetSize * v + i % kSetSize] = static_cast<std::uint32_t>(limited.row(v)[i].joint);
      set.weights[kSetSize * v + i % kSetSize] = weights[i];
    }
  }
  return sets;
}

Json joint_node(const std::string& name, const Transform& local) {
  const Eigen::Vector3d& t = local.translation;
  const Eigen::Vector3d& s = local.scale;
  const Eigen::Quaterniond q = local.rotation.normalized();
  return {{"name", name},
          {"translation", {t.x() + 0.0, t.y() + 0.0, t.z() + 0.0}},
          {"rotation", {q.x() + 0.0, q.y() + 0.0, q.z() + 0.0, q.w() + 0.0}},
          {"scale", {s.x(), s.y(), s.z()}}};
}

bool is_binary_extension(const std::filesystem::path& path) {
  const std::string extension = lower_case(path.extension().string());
  if (extension == ".glb" || extension == ".vrm") return true;
  if (extension == ".gltf") return false;
  throw InputError(path.string(), "", "a glTF file must be called .glb, .vrm or .gltf");
}

namespace {

template <typename T>
constexpr int kComponentType = static_cast<int>(std::is_same_v<T, std::uint8_t>    ? gltf_import::Component::kU8
                                                : std::is_same_v<T, std::uint16_t> ? gltf_import::Component::kU16
                                                : std::is_same_v<T, std::uint32_t> ? gltf_import::Component::kU32
                                                                                   : gltf_import::Component::kF32);

/// Targets of buffer views (glTF 2.0, section 5.11.5).
constexpr int kNoTarget = 0, kVertices = 34962, kIndices = 34963;

/// An object with this name, where there is one.
Json named(const std::string& name) { return name.empty() ? Json::object() : Json{{"name", name}}; }

/// The member `asset`: version, generator, and the program that made the file.
Json asset_block() {
  return {{"version", "2.0"}, {"generator", "AniGen in C++"}, {"extras", {{"made_by", made_by()}}}};
}

/// A glTF file being written: its JSON and its only binary buffer. Views and accessors are appended as the parts of
/// the asset are written, each aligned to 4 bytes.
class GltfDocument {
 public:
  Json json = {{"asset", asset_block()}};  ///< everything but "buffers", "bufferViews", "accessors"

  /// Copies bytes into the buffer. @return the index of the bufferView
  int add_view(const void* data, std::size_t bytes, int target = kNoTarget) {
    Json view = {{"buffer", 0}, {"byteOffset", binary_.size()}, {"byteLength", bytes}};
    if (target != kNoTarget) view["target"] = target;
    if (bytes > 0) binary_.append(static_cast<const char*>(data), bytes);
    binary_.append((4 - binary_.size() % 4) % 4, '\0');
    views_.push_back(std::move(view));
    return static_cast<int>(views_.size()) - 1;
  }

  /// An accessor of T into a view. @param width numbers per element @return its index
  template <typename T>
  int add_accessor(int view, std::size_t byte_offset, std::size_t width, std::size_t count) {
    Json accessor = {{"bufferView", view}};
    if (byte_offset > 0) accessor["byteOffset"] = byte_offset;
    accessor["componentType"] = kComponentType<T>;
    accessor["count"] = count;
    static constexpr const char* kVectors[] = {"SCALAR", "VEC2", "VEC3", "VEC4"};
    accessor["type"] = width <= 4 ? kVectors[width - 1] : "MAT4";
    accessors_.push_back(std::move(accessor));
    return static_cast<int>(accessors_.size()) - 1;
  }

  /// A view of its own with one accessor.
  template <typename T>
  int add(const std::vector<T>& values, std::size_t width, int target) {
    const int view = add_view(values.data(), values.size() * sizeof(T), target);
    return add_accessor<T>(view, 0, width, values.size() / width);
  }

  /// Adds the accessor's "min" and "max", which are exact because every float is a double.
  void set_bounds(int accessor, const float* values, std::size_t count, std::size_t width) {
    std::vector<double> low(values, values + width), high = low;
    for (std::size_t i = width; i < count; ++i) {
      low[i % width] = std::min<double>(low[i % width], values[i]);
      high[i % width] = std::max<double>(high[i % width], values[i]);
    }
    accessors_[at(accessor)]["min"] = low;
    accessors_[at(accessor)]["max"] = high;
  }

  const std::string& binary() const { return binary_; }

  /// The finished JSON. @param buffer_uri "uri" of the buffer; empty for the binary chunk of a .glb
  std::string json_text(const std::string& buffer_uri) const {
    Json whole = json;
    whole["accessors"] = accessors_;
    whole["bufferViews"] = views_;
    Json buffer = {{"byteLength", binary_.size()}};
    if (!buffer_uri.empty()) buffer["uri"] = buffer_uri;
    whole["buffers"] = Json::array({std::move(buffer)});
    // Names come from foreign files and need not be UTF-8, which JSON demands.
    return whole.dump(-1, ' ', false, Json::error_handler_t::replace);
  }

 private:
  std::string binary_;
  Json views_ = Json::array(), accessors_ = Json::array();
};

int write_image(GltfDocument& document, const EncodedImage& image, const std::string& file) {
  // From the first bytes, since the format demands that the declared type matches them.
  const char* type =
      gltf_import::picture_mime_type({reinterpret_cast<const char*>(image.bytes.data()), image.bytes.size()});
  if (type == nullptr) throw InputError(file, "", "image '" + image.name + "' of the asset is neither PNG nor JPEG");
  Json entry = {{"bufferView", document.add_view(image.bytes.data(), image.bytes.size())}, {"mimeType", type}};
  if (!image.name.empty()) entry["name"] = image.name;
  document.json["images"].push_back(std::move(entry));
  return static_cast<int>(document.json["images"].size()) - 1;
}

// One texture per image; both have the same index.
int texture_of(GltfDocument& document, const Asset& asset, int image, std::map<int, int>& textures,
               const std::string& file) {
  const auto [known, is_new] = textures.try_emplace(image, -1);
  if (!is_new) return known->second;
  known->second = write_image(document, asset.images[at(image)], file);
  document.json["textures"].push_back({{"source", known->second}});
  return known->second;
}

Json material_json(const Material& material) {
  Json factor = Json::array();
  for (const float x : material.base_color) factor.push_back(static_cast<double>(std::clamp(x, 0.0f, 1.0f)));
  Json entry = named(material.name);
  entry["pbrMetallicRoughness"] = {{"baseColorFactor", factor}, {"metallicFactor", 0.0}, {"roughnessFactor", 1.0}};
  if (material.double_sided) entry["doubleSided"] = true;
  if (material.alpha_mode == AlphaMode::kBlend) entry["alphaMode"] = "BLEND";
  if (material.alpha_mode == AlphaMode::kMask) {
    entry["alphaMode"] = "MASK";
    if (material.alpha_cutoff != 0.5f) entry["alphaCutoff"] = material.alpha_cutoff;
  }
  return entry;
}

/// Writes the materials that some face uses, with their textures and images, and a plain white one when some face
/// has none (glTF's implicit default is a metal, which our materials are not). Images are embedded byte for byte.
/// Textures are left out when the mesh has no uvs, since the format forbids them then.
/// @return index in the file by index in Asset::materials, -1 standing for "none"
std::map<int, int> write_materials(GltfDocument& document, const Asset& asset, const std::string& file) {
  const Mesh& mesh = asset.mesh;
  std::set<int> used(mesh.face_materials.begin(), mesh.face_materials.end());
  if (mesh.face_materials.empty()) used.insert(-1);
  std::map<int, int> index_in_file, textures;
  for (const int m : used) {
    Material plain;
    plain.name = "default";
    const Material& material = m < 0 ? plain : asset.materials[at(m)];
    Json entry = material_json(material);
    if (material.image >= 0 && !mesh.uvs.empty()) {
      const int texture = texture_of(document, asset, material.image, textures, file);
      entry["pbrMetallicRoughness"]["baseColorTexture"] = {{"index", texture}};
    }
    index_in_file[m] = static_cast<int>(document.json["materials"].size());
    document.json["materials"].push_back(std::move(entry));
  }
  return index_in_file;
}

std::vector<float> rotated(const std::vector<Eigen::Vector3f>& vectors, const Eigen::Matrix3d& rotation, bool unit) {
  std::vector<float> values;
  values.reserve(3 * vectors.size());
  for (const Eigen::Vector3f& v : vectors) {
    Eigen::Vector3d r = rotation * v.cast<double>();
    if (unit) {
      const double length = r.norm();
      // A normal without direction would make the file invalid; up is as good as any.
      r = length > 1e-12 ? Eigen::Vector3d(r / length) : Eigen::Vector3d::UnitY();
    }
    // The sum turns -0 into 0, which comparing tools and readers of the JSON bounds expect.
    for (int k = 0; k < 3; ++k) values.push_back(static_cast<float>(r[k]) + 0.0f);
  }
  return values;
}

/// JOINTS_n and WEIGHTS_n (float) as influence_sets() has them.
void write_skin_attributes(GltfDocument& document, Json& attributes, const SkinWeights& skin, std::size_t joints,
                           std::size_t influences) {
  const std::vector<gltf_import::InfluenceSet> sets = influence_sets(skin, influences);
  for (std::size_t set = 0; set < sets.size(); ++set) {
    const std::vector<std::uint32_t>& indices = sets[set].joints;
    attributes["JOINTS_" + std::to_string(set)] =
        joints <= kMostJointsInBytes
            ? document.add(std::vector<std::uint8_t>(indices.begin(), indices.end()), kSetSize, kVertices)
            : document.add(std::vector<std::uint16_t>(indices.begin(), indices.end()), kSetSize, kVertices);
    attributes["WEIGHTS_" + std::to_string(set)] = document.add(sets[set].weights, kSetSize, kVertices);
  }
}

Json write_attributes(GltfDocument& document, const Asset& asset, const Eigen::Matrix3d& rotation,
                      std::size_t influences) {
  const Mesh& mesh = asset.mesh;
  Json attributes = Json::object();
  const std::vector<float> positions = rotated(mesh.vertices, rotation, false);
  const int position = document.add(positions, 3, kVertices);
  document.set_bounds(position, positions.data(), positions.size(), 3);
  attributes["POSITION"] = position;
  if (!mesh.normals.empty()) attributes["NORMAL"] = document.add(rotated(mesh.normals, rotation, true), 3, kVertices);
  if (!mesh.uvs.empty()) {
    std::vector<float> values;
    for (const Eigen::Vector2f& uv : mesh.uvs) values.insert(values.end(), {uv.x(), uv.y()});
    attributes["TEXCOORD_0"] = document.add(values, 2, kVertices);
  }
  if (!mesh.colors.empty()) {
    std::vector<float> values;
    for (const Eigen::Vector4f& color : mesh.colors) {
      for (int k = 0; k < 4; ++k) values.push_back(std::clamp(color[k], 0.0f, 1.0f));
    }
    attributes["COLOR_0"] = document.add(values, 4, kVertices);
  }
  if (asset.skeleton.size() > 0)
    write_skin_attributes(document, attributes, asset.skin, asset.skeleton.size(), influences);
  return attributes;
}

int write_indices(GltfDocument& document, const std::vector<std::uint32_t>& indices) {
  const std::uint32_t largest = *std::max_element(indices.begin(), indices.end());
  // 65535 itself restarts a strip in OpenGL and is forbidden.
  if (largest < std::numeric_limits<std::uint16_t>::max())
    return document.add(std::vector<std::uint16_t>(indices.begin(), indices.end()), 1, kIndices);
  return document.add(indices, 1, kIndices);
}

/// Writes the only mesh: one primitive per material, all with the same vertex accessors, so that vertex order and count
/// survive. Faces are grouped by material and keep their order within a group.
void write_mesh(GltfDocument& document, const Asset& asset, const Eigen::Matrix3d& rotation,
                const std::map<int, int>& materials, std::size_t influences) {
  const Mesh& mesh = asset.mesh;
  const Json attributes = write_attributes(document, asset, rotation, influences);
  std::map<int, std::vector<std::uint32_t>> indices_by_material;
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    const int material = mesh.face_materials.empty() ? -1 : mesh.face_materials[f];
    std::vector<std::uint32_t>& indices = indices_by_material[material];
    for (const std::int32_t v : mesh.faces[f]) indices.push_back(static_cast<std::uint32_t>(v));
  }
  Json primitives = Json::array();
  for (const auto& [material, indices] : indices_by_material) {
    primitives.push_back({{"attributes", attributes},
                          {"indices", write_indices(document, indices)},
                          {"material", materials.at(material)},
                          {"mode", 4}});
  }
  Json entry = named(asset.name);
  entry["primitives"] = std::move(primitives);
  document.json["meshes"] = Json::array({std::move(entry)});
}

/// All joints in skeleton order (their node index is their joint index) and the inverse of rotation · bind.
void write_skin(GltfDocument& document, const Skeleton& skeleton, const Eigen::Matrix3d& rotation,
                const std::string& file) {
  Eigen::Matrix4d to_world = Eigen::Matrix4d::Identity();
  to_world.topLeftCorner<3, 3>() = rotation.transpose();
  std::vector<float> matrices;
  matrices.reserve(16 * skeleton.size());
  Json joints = Json::array();
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    Eigen::Matrix4f inverse = (skeleton.bind[j].inverse() * to_world).cast<float>();
    inverse.row(3) << 0.0f, 0.0f, 0.0f, 1.0f;
    if (!inverse.allFinite())
      throw InputError(file, "", "inverse bind matrix of joint " + std::to_string(j) + " exceeds single precision");
    matrices.insert(matrices.end(), inverse.data(), inverse.data() + 16);  // column-major, as in glTF
    joints.push_back(j);
  }
  document.json["skins"] = Json::array({{{"inverseBindMatrices", document.add(matrices, 16, kNoTarget)},
                                         {"skeleton", 0},
                                         {"joints", std::move(joints)}}});
}

std::string unused_node_name(const std::string& wanted, const std::vector<std::string>& taken) {
  std::string name = wanted;
  for (int i = 1; std::find(taken.begin(), taken.end(), name) != taken.end(); ++i)
    name = wanted + "_mesh" + (i == 1 ? "" : std::to_string(i));
  return name;
}

/// Node j is joint j in its rest pose; behind them the node of mesh and skin. It stands beside the root joint, not
/// below it, because the transform of a skinned mesh's node is ignored.
void write_nodes(GltfDocument& document, const Asset& asset, ExportAxes axes) {
  const Skeleton& skeleton = asset.skeleton;
  Json nodes = Json::array();
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    Transform rest = skeleton.rest[j];
    if (skeleton.parents[j] < 0) {
      rest.translation = axis_rotation(axes) * rest.translation;
      rest.rotation = axis_quaternion(axes) * rest.rotation;
    }
    nodes.push_back(joint_node(skeleton.names[j], rest));
  }
  for (std::size_t j = 0; j < skeleton.size(); ++j) {
    if (skeleton.parents[j] >= 0) nodes[at(skeleton.parents[j])]["children"].push_back(j);
  }
  Json roots = Json::array();
  if (skeleton.size() > 0) roots.push_back(0);
  if (!asset.mesh.vertices.empty()) {
    const std::string name = unused_node_name(asset.name.empty() ? "mesh" : asset.name, skeleton.names);
    roots.push_back(nodes.size());
    nodes.push_back({{"name", name}, {"mesh", 0}});
    if (skeleton.size() > 0) nodes.back()["skin"] = 0;
  }
  document.json["scene"] = 0;
  Json scene = named(asset.name);
  scene["nodes"] = std::move(roots);
  document.json["scenes"] = Json::array({std::move(scene)});
  document.json["nodes"] = std::move(nodes);
}

// Keys of one channel in single precision, in the file's axes.
struct Keys {
  std::vector<float> times, values;
  Interpolation interpolation = Interpolation::kLinear;
};

// The numbers of all animations share one view; accessors follow once it is complete.
struct Pool {
  struct Part {
    std::size_t offset, count, width;
    bool bounds;
  };
  std::vector<float> numbers;
  std::vector<Part> parts;
  std::map<std::vector<float>, std::size_t> known_times;  // exporters of animations repeat one time line per joint

  std::size_t add(const std::vector<float>& values, std::size_t width, bool bounds) {
    parts.push_back({numbers.size(), values.size() / width, width, bounds});
    numbers.insert(numbers.end(), values.begin(), values.end());
    return parts.size() - 1;
  }
  std::size_t add_times(const std::vector<float>& times) {
    const auto known = known_times.find(times);
    return known != known_times.end() ? known->second : known_times[times] = add(times, 1, true);
  }
};

[[noreturn]] void reject(const std::string& file, const Channel& channel, const std::string& problem) {
  throw InputError(file,
                   std::string("animation channel ") + gltf_import::name_of(channel.path) + " of joint " +
                       std::to_string(channel.joint),
                   problem);
}

// Turns the root's vectors into the file's axes, one element (key value or tangent) at a time.
void turn_root(const Channel& channel, ExportAxes axes, double* value) {
  if (channel.path == ChannelPath::kTranslation) {
    Eigen::Map<Eigen::Vector3d> v(value);
    v = (axis_rotation(axes) * v).eval();
  } else if (channel.path == ChannelPath::kRotation) {
    const Eigen::Quaterniond q = axis_quaternion(axes) * Eigen::Quaterniond(value[3], value[0], value[1], value[2]);
    value[0] = q.x(), value[1] = q.y(), value[2] = q.z(), value[3] = q.w();
  }
}

Keys convert(const Channel& channel, bool is_root, ExportAxes axes, const std::string& file) {
  const std::size_t width = channel.path == ChannelPath::kRotation ? 4 : 3;
  const bool cubic = channel.interpolation == Interpolation::kCubicSpline;
  const std::size_t per_key = width * (cubic ? 3 : 1);
  const std::size_t value_at = cubic ? width : 0;
  Keys keys;
  keys.interpolation = channel.interpolation;
  for (std::size_t k = 0; k < channel.times.size(); ++k) {
    std::vector<double> key(channel.values.begin() + static_cast<std::ptrdiff_t>(k * per_key),
                            channel.values.begin() + static_cast<std::ptrdiff_t>((k + 1) * per_key));
    if (is_root) {
      for (std::size_t i = 0; i < per_key; i += width) turn_root(channel, axes, key.data() + i);
    }
    if (channel.path == ChannelPath::kRotation) {
      const double length = Eigen::Map<Eigen::Vector4d>(key.data() + value_at).norm();
      if (!(length > 1e-12)) reject(file, channel, "key " + std::to_string(k) + " is a rotation of length zero");
      for (double& x : key) x /= length;
    }
    const float time = static_cast<float>(channel.times[k]);
    std::size_t keep = 0;
    if (!keys.times.empty() && time <= keys.times.back()) {
      // The merged key arrives with the tangent of the earlier and leaves with that of the later one.
      keep = value_at;
      keys.values.resize(keys.values.size() - per_key + keep);
    } else {
      keys.times.push_back(time);
    }
    for (std::size_t i = keep; i < per_key; ++i) keys.values.push_back(static_cast<float>(key[i]) + 0.0f);
  }
  for (const std::vector<float>* numbers : {&keys.times, &keys.values}) {
    for (const float x : *numbers) {
      if (!std::isfinite(x)) reject(file, channel, "a number exceeds single precision");
    }
  }
  if (cubic && keys.times.size() == 1) {  // the format wants two keys for a spline; one key is a constant
    keys.interpolation = Interpolation::kStep;
    keys.values = {keys.values.begin() + static_cast<std::ptrdiff_t>(value_at),
                   keys.values.begin() + static_cast<std::ptrdiff_t>(value_at + width)};
  }
  return keys;
}

// Samplers refer to parts of the pool here; write_animations() replaces them by accessors.
Json animation_json(const Animation& animation, const Asset& asset, ExportAxes axes, const std::string& file,
                    Pool& pool) {
  std::map<std::pair<int, ChannelPath>, const Channel*> last;
  for (const Channel& channel : animation.channels) last[{channel.joint, channel.path}] = &channel;
  Json channels = Json::array(), samplers = Json::array();
  for (const Channel& channel : animation.channels) {
    if (channel.times.empty() || last[{channel.joint, channel.path}] != &channel) continue;
    const bool is_root = asset.skeleton.parents[at(channel.joint)] < 0;
    const Keys keys = convert(channel, is_root, axes, file);
    const std::size_t input = pool.add_times(keys.times);
    const std::size_t output = pool.add(keys.values, channel.path == ChannelPath::kRotation ? 4 : 3, false);
    channels.push_back({{"sampler", samplers.size()},
                        {"target", {{"node", channel.joint}, {"path", gltf_import::name_of(channel.path)}}}});
    samplers.push_back(
        {{"input", input}, {"interpolation", gltf_import::name_of(keys.interpolation)}, {"output", output}});
  }
  Json entry = named(animation.name);
  entry["channels"] = std::move(channels);
  entry["samplers"] = std::move(samplers);
  return entry;
}

/// Keys whose times are equal in single precision are merged; of several channels for one property the last is written,
/// which is the one that sample() obeys; channels without keys are left out. The root's channels are turned into the
/// file's axes (cubic tangents too: a rotation is linear in them).
void write_animations(GltfDocument& document, const Asset& asset, ExportAxes axes, const std::string& file) {
  Pool pool;
  Json animations = Json::array();
  for (const Animation& animation : asset.animations) {
    Json entry = animation_json(animation, asset, axes, file, pool);
    if (!entry["channels"].empty()) animations.push_back(std::move(entry));
  }
  if (animations.empty()) return;
  const int view = document.add_view(pool.numbers.data(), pool.numbers.size() * sizeof(float));
  std::vector<int> accessors;
  for (const Pool::Part& part : pool.parts) {
    accessors.push_back(document.add_accessor<float>(view, part.offset * sizeof(float), part.width, part.count));
    if (part.bounds)
      document.set_bounds(accessors.back(), pool.numbers.data() + part.offset, part.count * part.width, part.width);
  }
  for (Json& animation : animations) {
    for (Json& sampler : animation["samplers"]) {
      sampler["input"] = accessors[sampler["input"].get<std::size_t>()];
      sampler["output"] = accessors[sampler["output"].get<std::size_t>()];
    }
  }
  document.json["animations"] = std::move(animations);
}

}  // namespace

void refuse_unsound(const std::string& file, const Asset& asset, const ExportOptions& options) {
  const auto refuse = [&file](const std::string& problem) { throw InputError(file, "", problem); };
  const std::vector<std::string> findings = validate(asset, 3, options.require_rig);
  const std::string more = findings.size() > 1 ? " (and " + std::to_string(findings.size() - 1) + " more)" : "";
  if (!findings.empty()) refuse("asset is not sound: " + findings.front() + more);
  const bool has_mesh = !asset.mesh.vertices.empty(), has_skeleton = asset.skeleton.size() > 0;
  if (asset.mesh.faces.empty() && (has_mesh || options.require_rig)) refuse("asset has no faces to write");
  if (!has_skeleton && options.require_rig) refuse("asset has no skeleton to write");
  if (has_mesh && has_skeleton && asset.skin.rows() == 0)
    refuse("asset has a mesh and a skeleton but no skin weights; anigen-rig --method heat makes some");
  if (options.influences == 0) refuse("influences per vertex must be at least 1");
}

std::string gltf_bytes(const std::string& file, const Asset& asset, bool binary, const ExportOptions& options) {
  refuse_unsound(file, asset, options);
  if (asset.skeleton.size() > kMostSkinJoints) throw NotSupportedError(file, "", "more than 65536 joints in glTF");
  const Eigen::Matrix3d rotation = axis_rotation(options.axes);
  GltfDocument document;
  write_nodes(document, asset, options.axes);
  if (!asset.mesh.vertices.empty()) {
    const std::map<int, int> materials = write_materials(document, asset, file);
    write_mesh(document, asset, rotation, materials, options.influences);
  }
  if (asset.skeleton.size() > 0) write_skin(document, asset.skeleton, rotation, file);
  if (options.animations) write_animations(document, asset, options.axes, file);
  if (options.extensions) {
    std::vector<int> nodes(asset.skeleton.size());
    std::iota(nodes.begin(), nodes.end(), 0);
    Json extensions = options.extensions(nodes), names = Json::array();
    for (const auto& [name, members] : extensions.items()) names.push_back(name);
    document.json["extensionsUsed"] = std::move(names);
    document.json["extensions"] = std::move(extensions);
  }
  if (binary) return gltf_import::glb_bytes(document.json_text(""), document.binary(), file);
  return document.json_text("data:application/octet-stream;base64," + base64(document.binary()));
}

void write_gltf(const std::filesystem::path& path, const Asset& asset, const ExportOptions& options) {
  write_file_atomically(path, gltf_bytes(path.string(), asset, is_binary_extension(path), options));
}

}  // namespace anigen::io
