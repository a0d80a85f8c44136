#include "anigen/io/gltf/primitive.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <optional>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/nearest_point.h"
#include "anigen/io/gltf/accessors.h"
#include "anigen/io/gltf/compression.h"

namespace anigen::io::gltf_import {

TriangleList triangulate(int mode, const std::vector<std::uint32_t>& indices) {
  TriangleList result;
  const auto add = [&](std::size_t a, std::size_t b, std::size_t c) {
    const Triangle face = {static_cast<std::int32_t>(indices[a]), static_cast<std::int32_t>(indices[b]),
                           static_cast<std::int32_t>(indices[c])};
    if (face[0] == face[1] || face[1] == face[2] || face[2] == face[0])
      ++result.degenerate;
    else
      result.faces.push_back(face);
  };
  const std::size_t count = indices.size();
  if (mode == 4) {
    result.faces.reserve(count / 3);
    for (std::size_t i = 0; i + 3 <= count; i += 3) add(i, i + 1, i + 2);
    result.left_over = count % 3;
  } else {
    result.left_over = count < 3 ? count : 0;
    for (std::size_t i = 0; i + 3 <= count; ++i) {
      if (mode == 5)
        add(i, i + 1 + i % 2, i + 2 - i % 2);  // every second triangle of a strip is turned around
      else
        add(i + 1, i + 2, 0);
    }
  }
  return result;
}

namespace {

constexpr std::size_t kMostInfluenceSets = 16;

// Attributes of one primitive, wherever they are stored.
class Attributes {
 public:
  Attributes(const Document& document, const Primitive& primitive, const DracoMesh* draco, std::size_t count)
      : document_(document), primitive_(primitive), draco_(draco), count_(count) {}

  bool has(const std::string& name) const { return primitive_.attribute(name) >= 0; }
  const Accessor& accessor(const std::string& name) const {
    return document_.accessors[at(primitive_.attribute(name))];
  }
  [[noreturn]] void fail(const std::string& name, const std::string& problem) const {
    throw InputError(document_.file, primitive_.pointer + "/attributes/" + name, problem);
  }

  // @param types allowed accessor types @param always_normalized integers stand for [0, 1] whatever the file says
  std::vector<float> floats(const std::string& name, const std::vector<std::string>& types,
                            bool always_normalized = false) const {
    check(name, types);
    const Accessor& accessor = this->accessor(name);
    std::vector<float> values = source(name);
    if (always_normalized && !accessor.normalized && accessor.component != Component::kF32) {
      const auto scale = static_cast<float>(normalized_scale(accessor.component));
      for (float& value : values) value *= scale;
    }
    return values;
  }

  std::vector<std::uint32_t> joints(const std::string& name) const {
    check(name, {"VEC4"});
    const Component component = accessor(name).component;
    if (component != Component::kU8 && component != Component::kU16)
      fail(name, "joint indices must be unsigned bytes or shorts");
    if (!in_draco(name)) return read_unsigned(document_, primitive_.attribute(name));
    std::vector<std::uint32_t> result;
    for (const float value : source(name))
      result.push_back(value >= 0.0f && value <= 65535.0f ? static_cast<std::uint32_t>(value) : 65535u);
    return result;
  }

 private:
  const std::vector<float>* in_draco(const std::string& name) const {
    if (draco_ == nullptr) return nullptr;
    for (const auto& [key, values] : draco_->attributes) {
      if (key == name) return &values;
    }
    return nullptr;
  }
  std::vector<float> source(const std::string& name) const {
    const std::vector<float>* decoded = in_draco(name);
    return decoded != nullptr ? *decoded : read_floats(document_, primitive_.attribute(name));
  }
  void check(const std::string& name, const std::vector<std::string>& types) const {
    const Accessor& accessor = this->accessor(name);
    if (std::find(types.begin(), types.end(), accessor.type) == types.end())
      fail(name, "expected " + types.front() + ", found " + accessor.type);
    if (accessor.component == Component::kU32) fail(name, "32-bit integers are not allowed here");
    if (in_draco(name) == nullptr && accessor.count != count_) {
      fail(name, std::to_string(accessor.count) + " elements for " + std::to_string(count_) +
                     " vertices: all attributes of a primitive must have the same count");
    }
  }

  const Document& document_;
  const Primitive& primitive_;
  const DracoMesh* draco_;
  std::size_t count_;
};

std::vector<float> read_positions(const Attributes& attributes) {
  std::vector<float> positions = attributes.floats("POSITION", {"VEC3"});
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (!std::isfinite(positions[i])) attributes.fail("POSITION", "vertex " + std::to_string(i / 3) + " is not finite");
  }
  return positions;
}

std::vector<float> read_uvs(const Attributes& attributes, const TextureUse& texture, Notes& notes) {
  std::string name = "TEXCOORD_" + std::to_string(texture.set);
  if (!attributes.has(name)) name = "TEXCOORD_0";
  if (!attributes.has(name)) return {};
  std::vector<float> uvs = attributes.floats(name, {"VEC2"});
  const Eigen::Matrix2f linear = texture.linear.cast<float>();
  const Eigen::Vector2f offset = texture.offset.cast<float>();
  for (std::size_t v = 0; v + 2 <= uvs.size(); v += 2) {
    Eigen::Map<Eigen::Vector2f> uv(uvs.data() + v);
    if (texture.is_transformed) uv = Eigen::Vector2f(linear * uv + offset);
    if (uv.allFinite()) continue;
    uv.setZero();
    notes.tally("repaired_uvs", "texture coordinates were not finite and became 0");
  }
  if (texture.is_transformed) notes.add("texture_transform", "KHR_texture_transform was applied to the uvs");
  return uvs;
}

std::vector<float> read_colors(const Attributes& attributes, Notes& notes) {
  if (!attributes.has("COLOR_0")) return {};
  const std::vector<float> values = attributes.floats("COLOR_0", {"VEC4", "VEC3"}, true);
  const std::size_t width = attributes.accessor("COLOR_0").width;
  std::vector<float> colors(values.size() / width * 4, 1.0f);
  for (std::size_t i = 0; i < values.size(); ++i) {
    float value = values[i];
    if (!std::isfinite(value)) {
      value = 1.0f;
      notes.tally("repaired_colors", "vertex colour components were not finite and became 1");
    }
    colors[i / width * 4 + i % width] = std::clamp(value, 0.0f, 1.0f);
  }
  return colors;
}

// Half a step of the storage per weight: correct integers can miss a sum of 1 by that much.
float rounding_of(Component component) {
  if (component == Component::kU8 || component == Component::kI8) return 0.5f / 127.0f;
  if (component == Component::kU16 || component == Component::kI16) return 0.5f / 32767.0f;
  return 0.0f;
}

void read_influences(const Attributes& attributes, VertexBlock& block) {
  for (std::size_t set = 0;; ++set) {
    const std::string joints = "JOINTS_" + std::to_string(set), weights = "WEIGHTS_" + std::to_string(set);
    if (!attributes.has(joints) && !attributes.has(weights)) return;
    if (!attributes.has(joints)) attributes.fail(weights, "there is no " + joints + " to go with it");
    if (!attributes.has(weights)) attributes.fail(joints, "there is no " + weights + " to go with it");
    if (set >= kMostInfluenceSets)
      attributes.fail(joints, "more than " + std::to_string(4 * kMostInfluenceSets) + " influences per vertex");
    block.influences.push_back({attributes.joints(joints), attributes.floats(weights, {"VEC4"}, true)});
    block.weight_rounding += 4.0f * rounding_of(attributes.accessor(weights).component);
  }
}

void check_indices(const Document& document, const Primitive& primitive, const std::vector<std::uint32_t>& indices,
                   std::size_t vertices) {
  for (std::size_t i = 0; i < indices.size(); ++i) {
    if (indices[i] < vertices) continue;
    throw InputError(document.file, primitive.pointer + "/indices",
                     "index " + std::to_string(i) + " refers to vertex " + std::to_string(indices[i]) + " of " +
                         std::to_string(vertices));
  }
}

void check_limit(const Document& document, const Primitive& primitive, std::size_t count, std::size_t limit,
                 const char* what) {
  if (count <= limit) return;
  throw InputError(document.file, primitive.pointer,
                   std::string("the file has more ") + what + " than the importer's limit");
}

}  // namespace

std::vector<std::uint32_t> read_indices(const Document& document, const Primitive& primitive, std::size_t vertices,
                                        std::size_t max_faces) {
  const std::size_t per_face = primitive.mode == 4 ? 3 : 1;
  if (primitive.indices < 0) {
    check_limit(document, primitive, vertices / per_face, max_faces, "faces");
    std::vector<std::uint32_t> indices(vertices);
    std::iota(indices.begin(), indices.end(), 0u);
    return indices;
  }
  const std::size_t count = document.accessors[at(primitive.indices)].count;
  check_limit(document, primitive, count / per_face, max_faces, "faces");
  std::vector<std::uint32_t> indices = read_unsigned(document, primitive.indices);
  check_indices(document, primitive, indices, vertices);
  return indices;
}

PrimitiveData read_primitive(const Document& document, const Primitive& primitive, const TextureUse& texture,
                             std::size_t max_vertices, std::size_t max_faces, Notes& notes) {
  PrimitiveData data;
  if (primitive.attribute("POSITION") < 0)
    throw InputError(document.file, primitive.pointer + "/attributes", "'POSITION' is missing");
  std::optional<DracoMesh> draco;
  VertexBlock& block = data.vertices;
  block.count = document.accessors[at(primitive.attribute("POSITION"))].count;
  check_limit(document, primitive, block.count, max_vertices, "vertices");
  if (primitive.draco_view >= 0) {
    draco = decode_draco(document, primitive, max_vertices, max_faces);
    block.count = draco->vertices;
    data.indices = std::move(draco->indices);
    check_indices(document, primitive, data.indices, block.count);
    notes.tally("decoded_draco", "primitives decoded from KHR_draco_mesh_compression");
  } else {
    data.indices = read_indices(document, primitive, block.count, max_faces);
  }
  const Attributes attributes(document, primitive, draco ? &*draco : nullptr, block.count);
  block.positions = read_positions(attributes);
  if (attributes.has("NORMAL")) block.normals = attributes.floats("NORMAL", {"VEC3"});
  block.uvs = read_uvs(attributes, texture, notes);
  block.colors = read_colors(attributes, notes);
  read_influences(attributes, block);
  if (primitive.has_targets) notes.tally("morph_targets", "primitives have morph targets, which were ignored");
  return data;
}

namespace {

// Exporters print and round float weights; what is further from 1 was not normalised at all.
constexpr double kFloatRounding = 1e-3;

// Below this a row is what is left of rounding, and says nothing about where the vertex belongs.
constexpr double kNoWeight = 1e-6;

enum class Row { kGood, kZero, kNotFinite };

class RowReader {
 public:
  RowReader(const VertexBlock& block, const SkinBinding& binding, const std::string& file, const std::string& pointer)
      : block_(block), binding_(binding), file_(file), pointer_(pointer) {}

  Row read(std::size_t vertex, std::vector<Influence>& row) {
    row.clear();
    double sum = 0.0;
    bool is_finite = true, is_negative = false;
    for (std::size_t set = 0; set < block_.influences.size(); ++set) {
      const InfluenceSet& influences = block_.influences[set];
      for (std::size_t k = 4 * vertex; k < 4 * vertex + 4; ++k) {
        const float weight = influences.weights[k];
        const std::uint32_t joint = influences.joints[k];
        is_finite = is_finite && std::isfinite(weight);
        is_negative = is_negative || weight < 0.0f;
        const bool in_range = joint < binding_.joints.size();
        if (!in_range && weight > 0.0f) {
          throw InputError(file_, pointer_ + "/attributes/JOINTS_" + std::to_string(set),
                           "vertex " + std::to_string(vertex) + " is bound to joint " + std::to_string(joint) +
                               " of a skin with " + std::to_string(binding_.joints.size()));
        }
        unused_index_ += in_range ? 0 : 1;
        if (!(weight > 0.0f) || !std::isfinite(weight)) continue;
        row.push_back({binding_.joints[joint], weight});
        sum += static_cast<double>(weight);
      }
    }
    if (!is_finite) return Row::kNotFinite;
    negative_ += is_negative ? 1 : 0;
    if (!(sum > kNoWeight)) return Row::kZero;
    lowest_sum_ = std::min(lowest_sum_, sum);
    if (std::abs(sum - 1.0) > kFloatRounding + static_cast<double>(block_.weight_rounding)) ++unnormalised_;
    // Done in double here, because adding up repeated joints in float could overflow.
    for (Influence& influence : row) influence.weight = static_cast<float>(static_cast<double>(influence.weight) / sum);
    return Row::kGood;
  }

  void note(Notes& notes) const {
    notes.weight_sum(lowest_sum_);
    notes.tally("negative_weights", "vertices had negative weights, taken as 0", negative_);
    notes.tally("unnormalised_weights", "vertices had weights that did not sum to 1 and were divided by their sum",
                unnormalised_);
    notes.tally("unused_joint_index", "joint indices outside the skin had no weight and were ignored", unused_index_);
  }

 private:
  const VertexBlock& block_;
  const SkinBinding& binding_;
  const std::string& file_;
  const std::string& pointer_;
  std::size_t negative_ = 0, unnormalised_ = 0, unused_index_ = 0;
  double lowest_sum_ = 1.0;
};

Eigen::Vector3f position(const VertexBlock& block, std::size_t vertex) {
  return Eigen::Map<const Eigen::Vector3f>(block.positions.data() + 3 * vertex);
}

// Finds rows for vertices without usable weights; built on the first such vertex.
class Substitute {
 public:
  Substitute(const VertexBlock& block, const SkinBinding& binding, const std::vector<Eigen::Vector3d>& joint_positions,
             const std::vector<Row>& rows) {
    for (std::size_t v = 0; v < rows.size(); ++v) {
      if (rows[v] == Row::kGood) vertices_.push_back(v);
    }
    std::vector<Eigen::Vector3d> points;
    if (!vertices_.empty()) {
      for (const std::size_t v : vertices_) points.push_back(position(block, v).cast<double>());
    } else {
      for (const int joint : binding.joints) points.push_back(joint_positions[at(joint)]);
    }
    nearest_ = std::make_unique<geometry::PointIndex>(std::move(points));
  }

  // @return a row in `row`
  void find(std::size_t vertex, const VertexBlock& block, const SkinBinding& binding, RowReader& reader,
            std::vector<Influence>& row) const {
    const Eigen::Vector3d p = position(block, vertex).cast<double>();
    if (!vertices_.empty()) {
      reader.read(vertices_[nearest_->nearest(p).index], row);
      return;
    }
    const Eigen::Vector4d bound = binding.to_bind * p.homogeneous();
    row = {{binding.joints[nearest_->nearest(bound.head<3>()).index], 1.0f}};
  }

 private:
  std::vector<std::size_t> vertices_;
  std::unique_ptr<geometry::PointIndex> nearest_;
};

}  // namespace

void append_weights(const VertexBlock& block, const SkinBinding& binding,
                    const std::vector<Eigen::Vector3d>& joint_positions, const std::string& file,
                    const std::string& pointer, SkinWeights& weights, Notes& notes) {
  RowReader reader(block, binding, file, pointer);
  std::vector<Row> rows(block.count);
  std::vector<Influence> row;
  std::size_t zero = 0, not_finite = 0;
  for (std::size_t v = 0; v < block.count; ++v) {
    rows[v] = reader.read(v, row);
    zero += rows[v] == Row::kZero ? 1 : 0;
    not_finite += rows[v] == Row::kNotFinite ? 1 : 0;
  }
  reader.note(notes);
  notes.tally("nan_weights", "vertices had weights that are not numbers and were bound like their nearest neighbour",
              not_finite);
  notes.tally("zero_weights", "vertices had no weight and were bound like their nearest neighbour", zero);
  std::unique_ptr<Substitute> substitute;
  if (zero + not_finite > 0) substitute = std::make_unique<Substitute>(block, binding, joint_positions, rows);
  for (std::size_t v = 0; v < block.count; ++v) {
    if (rows[v] == Row::kGood)
      reader.read(v, row);
    else
      substitute->find(v, block, binding, reader, row);
    weights.append_row(row);
  }
}

}  // namespace anigen::io::gltf_import
