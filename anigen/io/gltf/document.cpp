#include "anigen/io/gltf/document.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "anigen/core/numeric.h"

namespace anigen::io::gltf_import {

namespace {

void check_version(const JsonPlace& root) {
  const JsonPlace asset = root.at("asset");
  const std::string version = asset.at("version").string();
  if (version.rfind("2.", 0) != 0) asset.not_supported("glTF version '" + version.substr(0, 20) + "'");
  const std::string minimum = asset.string_or("minVersion", "2.0");
  if (minimum != "2.0") asset.not_supported("glTF minVersion '" + minimum.substr(0, 20) + "'");
}

// Extensions that a file may require and that we read, or that change nothing we keep (shading, lights).
bool is_supported(const std::string& extension) {
  static const std::set<std::string> read = {"KHR_draco_mesh_compression", "EXT_meshopt_compression",
                                             "KHR_mesh_quantization", "KHR_texture_transform", "KHR_lights_punctual"};
  return read.count(extension) != 0 || extension.rfind("KHR_materials_", 0) == 0;
}

// Member of a key whose words are name_of(), for the first three values of an enum.
template <typename Enum>
Enum parse_enum(const JsonPlace& place, const std::string& key, const std::string& name) {
  for (const int value : {0, 1, 2}) {
    if (name == name_of(static_cast<Enum>(value))) return static_cast<Enum>(value);
  }
  place.at(key.c_str()).fail("unknown " + key + " '" + name.substr(0, 20) + "'");
}

// Types and lengths of a sampler's accessors for the property they drive (glTF 2.0, section 3.11).
void check_sampler(const JsonPlace& sampler, const Document& document, const AnimationChannel& channel) {
  const Accessor& input = document.accessors[at(channel.input)];
  const Accessor& output = document.accessors[at(channel.output)];
  if (input.type != "SCALAR" || input.component != Component::kF32)
    sampler.at("input").fail("key times must be 32-bit float SCALARs");
  const bool rotation = channel.path == ChannelPath::kRotation;
  if (output.type != (rotation ? "VEC4" : "VEC3"))
    sampler.at("output").fail(std::string("expected ") + (rotation ? "VEC4" : "VEC3") + " values, found " +
                              output.type);
  if (output.component == Component::kU32) sampler.at("output").fail("key values cannot be 32-bit integers");
  const std::size_t parts = channel.interpolation == Interpolation::kCubicSpline ? 3 : 1;
  if (output.count != parts * input.count) {
    sampler.at("output").fail("there are " + std::to_string(output.count) + " values for " +
                              std::to_string(input.count) + " keys");
  }
}

AnimationEntry parse_animation(const JsonPlace& place, const Document& document, Notes& notes) {
  AnimationEntry animation;
  animation.name = place.string_or("name", "");
  place.at("channels");
  const JsonPlace samplers = place.at("samplers");
  for (const JsonPlace& entry : place.entries("channels")) {
    AnimationChannel channel;
    channel.pointer = entry.pointer();
    const JsonPlace sampler = samplers[at(entry.index("sampler", samplers.size(), "sampler"))];
    channel.input = sampler.index("input", document.accessors.size(), "accessor");
    channel.output = sampler.index("output", document.accessors.size(), "accessor");
    channel.interpolation =
        parse_enum<Interpolation>(sampler, "interpolation", sampler.string_or("interpolation", "LINEAR"));
    const JsonPlace target = entry.at("target");
    const std::string path = target.at("path").string();
    channel.node = target.index_or_none("node", document.nodes.size(), "node");
    if (path == "weights") {
      notes.tally("morph_targets", "animation channels of morph targets were ignored");
      continue;
    }
    if (path == "pointer" || channel.node < 0) {
      notes.tally("dropped_channels", "animation channels without a target node were dropped");
      continue;
    }
    channel.path = parse_enum<ChannelPath>(target, "path", path);
    check_sampler(sampler, document, channel);
    animation.channels.push_back(std::move(channel));
  }
  return animation;
}

void parse_animations(const JsonPlace& root, Document& document, Notes& notes) {
  for (const JsonPlace& place : root.entries("animations"))
    document.animations.push_back(parse_animation(place, document, notes));
}

// A member of N numbers; `fallback` where it is absent.
template <int N>
Eigen::Matrix<double, N, 1> vector_or(const JsonPlace& place, const char* key,
                                      const Eigen::Matrix<double, N, 1>& fallback) {
  const auto member = place.find(key);
  return member ? Eigen::Matrix<double, N, 1>(member->numbers(N).data()) : fallback;
}

// KHR_texture_transform: uv' = T · R · S · uv, with R turning by -rotation in a frame whose v points down.
void parse_texture_transform(const JsonPlace& extension, TextureUse& use) {
  use.offset = vector_or(extension, "offset", use.offset);
  const Eigen::Vector2d scale = vector_or<2>(extension, "scale", Eigen::Vector2d::Ones());
  double angle = 0.0;
  if (const auto rotation = extension.find("rotation")) angle = rotation->number();
  Eigen::Matrix2d rotation;
  rotation << std::cos(angle), std::sin(angle), -std::sin(angle), std::cos(angle);
  use.linear = rotation * scale.asDiagonal();
  use.set = static_cast<int>(extension.integer_or("texCoord", static_cast<std::uint64_t>(use.set), 255));
  use.is_transformed = true;
}

TextureUse parse_texture(const JsonPlace& place, std::size_t textures) {
  TextureUse use;
  use.texture = place.index("index", textures, "texture");
  use.set = static_cast<int>(place.integer_or("texCoord", 0, 255));
  if (const auto transform = place.extension("KHR_texture_transform")) parse_texture_transform(*transform, use);
  return use;
}

void parse_base_color(const JsonPlace& place, const char* factor_key, const char* texture_key, std::size_t textures,
                      MaterialEntry& entry) {
  if (const auto factor = place.find(factor_key)) {
    const std::vector<double> f = factor->numbers(4);
    for (std::size_t i = 0; i < 4; ++i)
      entry.material.base_color[static_cast<Eigen::Index>(i)] = static_cast<float>(std::clamp(f[i], 0.0, 1.0));
  }
  if (const auto texture = place.find(texture_key)) entry.base_color = parse_texture(*texture, textures);
}

MaterialEntry parse_material(const JsonPlace& place, std::size_t textures) {
  MaterialEntry entry;
  entry.material.name = place.string_or("name", "");
  entry.material.double_sided = place.boolean_or("doubleSided", false);
  const std::string alpha = place.string_or("alphaMode", "OPAQUE");
  entry.material.alpha_mode = alpha == "OPAQUE"  ? AlphaMode::kOpaque
                              : alpha == "MASK"  ? AlphaMode::kMask
                              : alpha == "BLEND" ? AlphaMode::kBlend
                                                 : AlphaMode::kUnknown;
  if (const auto cutoff = place.find("alphaCutoff"))
    entry.material.alpha_cutoff = static_cast<float>(std::max(cutoff->number(), 0.0));
  if (const auto pbr = place.find("pbrMetallicRoughness")) {
    parse_base_color(*pbr, "baseColorFactor", "baseColorTexture", textures, entry);
  } else if (const auto specular = place.extension("KHR_materials_pbrSpecularGlossiness")) {
    // The older model's diffuse colour is the closest thing to a base colour such a material has.
    parse_base_color(*specular, "diffuseFactor", "diffuseTexture", textures, entry);
  }
  return entry;
}

void parse_materials(const JsonPlace& root, Document& document, Notes& notes) {
  for (const JsonPlace& place : root.entries("images")) {
    ImageEntry image;
    image.pointer = place.pointer();
    image.name = place.string_or("name", "");
    place.string_or("mimeType", "");
    image.uri = place.string_or("uri", "");
    image.view = place.index_or_none("bufferView", document.views.size(), "bufferView");
    document.images.push_back(std::move(image));
  }
  for (const JsonPlace& place : root.entries("textures")) {
    document.texture_images.push_back(place.index_or_none("source", document.images.size(), "image"));
    if (document.texture_images.back() < 0)
      notes.tally("unsupported_texture", "textures without a PNG or JPEG source were left out");
  }
  for (const JsonPlace& place : root.entries("materials"))
    document.materials.push_back(parse_material(place, document.texture_images.size()));
}

void parse_draco(const JsonPlace& extension, const Document& document, Primitive& primitive) {
  primitive.draco_view = extension.index("bufferView", document.views.size(), "bufferView");
  const JsonPlace attributes = extension.at("attributes");
  for (const std::string& name : attributes.keys()) {
    const JsonPlace id = attributes.at(name.c_str());
    if (primitive.attribute(name) < 0) id.fail("the primitive itself has no attribute '" + name.substr(0, 40) + "'");
    primitive.draco_attributes.emplace_back(name, static_cast<std::uint32_t>(id.integer(0, 0xFFFFFFFF)));
  }
  if (primitive.mode != 4 && primitive.mode != 5) extension.fail("Draco holds triangles only");
}

Primitive parse_primitive(const JsonPlace& place, const Document& document, std::size_t materials) {
  Primitive primitive;
  primitive.pointer = place.pointer();
  primitive.mode = static_cast<int>(place.integer_or("mode", 4, 6));
  primitive.material = place.index_or_none("material", materials, "material");
  primitive.indices = place.index_or_none("indices", document.accessors.size(), "accessor");
  if (primitive.indices >= 0) {
    const Accessor& accessor = document.accessors[at(primitive.indices)];
    if (accessor.type != "SCALAR" || !is_unsigned(accessor.component))
      place.at("indices").fail("indices must be unsigned SCALARs, not " + accessor.type);
  }
  const JsonPlace attributes = place.at("attributes");
  for (const std::string& name : attributes.keys()) {
    const int accessor = attributes.index(name.c_str(), document.accessors.size(), "accessor");
    primitive.attributes.emplace_back(name, accessor);
  }
  if (const auto targets = place.find("targets")) primitive.has_targets = targets->size() > 0;
  if (const auto draco = place.extension("KHR_draco_mesh_compression")) parse_draco(*draco, document, primitive);
  return primitive;
}

void parse_meshes(const JsonPlace& root, Document& document) {
  for (const JsonPlace& place : root.entries("meshes")) {
    place.at("primitives");
    MeshEntry mesh;
    for (const JsonPlace& primitive : place.entries("primitives"))
      mesh.primitives.push_back(parse_primitive(primitive, document, document.materials.size()));
    document.meshes.push_back(std::move(mesh));
  }
}

Transform parse_trs(const JsonPlace& place, Notes& notes) {
  Transform local;
  local.translation = vector_or(place, "translation", local.translation);
  if (const auto rotation = place.find("rotation")) {
    const std::vector<double> q = rotation->numbers(4);
    local.rotation = Eigen::Quaterniond(q[3], q[0], q[1], q[2]);
    const double norm = local.rotation.norm();
    if (!(norm > 1e-9) || !std::isfinite(norm)) rotation->fail("the rotation is not a quaternion of unit length");
    if (std::abs(norm - 1.0) > 1e-3)
      notes.tally("unnormalised_rotation", "node rotations were not of unit length and were normalised");
    local.rotation.coeffs() /= norm;
  }
  local.scale = vector_or(place, "scale", local.scale);
  return local;
}

void parse_transform(const JsonPlace& place, Node& node, Notes& notes) {
  const auto matrix = place.find("matrix");
  if (!matrix) {
    node.local = parse_trs(place, notes);
    node.matrix = node.local.matrix();
  } else {
    const std::vector<double> m = matrix->numbers(16);
    node.matrix = Eigen::Map<const Eigen::Matrix4d>(m.data());
    // Exporters write float noise here; anything more is a projection, which glTF does not allow.
    if ((node.matrix.row(3) - Eigen::RowVector4d(0, 0, 0, 1)).cwiseAbs().maxCoeff() > 1e-3)
      matrix->fail("the last row of a node's matrix must be 0 0 0 1");
    node.matrix.row(3) = Eigen::RowVector4d(0, 0, 0, 1);
    node.local = decompose(node.matrix, &node.shear);
  }
  const Transform& local = node.local;
  if (!node.matrix.allFinite() || !local.translation.allFinite() || !local.rotation.coeffs().allFinite() ||
      !local.scale.allFinite() || !std::isfinite(node.matrix.squaredNorm())) {
    place.fail("the node's transform is not finite");
  }
}

// Gives every node its parent, refusing a second one: with the check for cycles that makes the graph a forest.
void link(const JsonPlace& list, std::vector<Node>& nodes) {
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    for (const JsonPlace& place : list[i].entries("children")) {
      const int child = place.as_index(nodes.size(), "node");
      Node& node = nodes[at(child)];
      if (node.parent >= 0)
        place.fail("node " + std::to_string(child) + " already is a child of node " + std::to_string(node.parent));
      node.parent = static_cast<int>(i);
      nodes[i].children.push_back(child);
    }
  }
}

// Breadth first from the roots; nodes of a cycle are never reached.
std::vector<int> top_down_order(const JsonPlace& list, const std::vector<Node>& nodes) {
  std::vector<int> order;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (nodes[i].parent < 0) order.push_back(static_cast<int>(i));
  }
  for (std::size_t k = 0; k < order.size(); ++k) {
    for (const int child : nodes[at(order[k])].children) order.push_back(child);
  }
  if (order.size() == nodes.size()) return order;
  std::vector<char> reached(nodes.size(), 0);
  for (const int node : order) reached[at(node)] = 1;
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    if (reached[i] == 0) list[i].fail("node " + std::to_string(i) + " is its own ancestor: the node graph has a cycle");
  }
  return order;
}

void mark_scene(const JsonPlace& root, const ImportOptions& options, Document& document) {
  const std::size_t scenes = root.size_of("scenes");
  int scene = root.index_or_none("scene", scenes, "scene");
  if (options.scene >= 0) {
    if (static_cast<std::size_t>(options.scene) >= scenes)
      root.fail("scene " + std::to_string(options.scene) + " was asked for, the file has " + std::to_string(scenes));
    scene = options.scene;
  }
  if (scene < 0 && scenes > 0) scene = 0;
  document.in_scene.assign(document.nodes.size(), scene < 0 ? 1 : 0);
  if (scene < 0) return;  // a file without scenes: everything is shown
  for (const JsonPlace& node : root.at("scenes")[at(scene)].entries("nodes"))
    document.in_scene[at(node.as_index(document.nodes.size(), "node"))] = 1;
  for (const int n : document.top_down) {
    const int parent = document.nodes[at(n)].parent;
    if (parent >= 0 && document.in_scene[at(parent)] != 0) document.in_scene[at(n)] = 1;
  }
}

void parse_nodes(const JsonPlace& root, const ImportOptions& options, Document& document, Notes& notes) {
  const std::size_t meshes = root.size_of("meshes"), skins = root.size_of("skins");
  if (const auto list = root.find("nodes")) {
    if (list->size() > options.max_nodes)
      list->fail(std::to_string(list->size()) + " nodes exceed the limit of " + std::to_string(options.max_nodes));
    for (const JsonPlace& place : root.entries("nodes")) {
      Node node;
      node.name = place.string_or("name", "");
      node.mesh = place.index_or_none("mesh", meshes, "mesh");
      node.skin = place.index_or_none("skin", skins, "skin");
      parse_transform(place, node, notes);
      document.nodes.push_back(std::move(node));
    }
    link(*list, document.nodes);
    document.top_down = top_down_order(*list, document.nodes);
  }
  mark_scene(root, options, document);
}

void parse_skins(const JsonPlace& root, Document& document) {
  for (const JsonPlace& place : root.entries("skins")) {
    Skin skin;
    skin.pointer = place.pointer();
    const JsonPlace joints = place.at("joints");
    if (joints.size() == 0) joints.fail("the skin has no joints");
    if (joints.size() > document.nodes.size()) joints.fail("the skin lists more joints than the file has nodes");
    std::vector<char> listed(document.nodes.size(), 0);
    for (std::size_t k = 0; k < joints.size(); ++k) {
      const int joint = joints[k].as_index(document.nodes.size(), "node");
      if (listed[at(joint)]++ != 0) joints[k].fail("node " + std::to_string(joint) + " is listed twice");
      skin.joints.push_back(joint);
    }
    place.index_or_none("skeleton", document.nodes.size(), "node");
    skin.inverse_bind_accessor = place.index_or_none("inverseBindMatrices", document.accessors.size(), "accessor");
    if (skin.inverse_bind_accessor >= 0) {
      const Accessor& accessor = document.accessors[at(skin.inverse_bind_accessor)];
      const JsonPlace where = place.at("inverseBindMatrices");
      if (accessor.type != "MAT4" || accessor.component != Component::kF32)
        where.fail("inverse bind matrices must be 32-bit float MAT4");
      if (accessor.count < skin.joints.size()) {
        where.fail("there are " + std::to_string(accessor.count) + " inverse bind matrices for " +
                   std::to_string(skin.joints.size()) + " joints");
      }
    }
    document.skins.push_back(std::move(skin));
  }
}

}  // namespace

const char* picture_mime_type(std::string_view bytes) {
  if (bytes.substr(0, 8) == "\x89PNG\r\n\x1a\n") return "image/png";
  return bytes.substr(0, 3) == "\xFF\xD8\xFF" ? "image/jpeg" : nullptr;
}

const char* name_of(ChannelPath path) {
  return path == ChannelPath::kTranslation ? "translation" : path == ChannelPath::kRotation ? "rotation" : "scale";
}

const char* name_of(Interpolation interpolation) {
  return interpolation == Interpolation::kStep     ? "STEP"
         : interpolation == Interpolation::kLinear ? "LINEAR"
                                                   : "CUBICSPLINE";
}

Document parse_document(const Container& container, const ImportOptions& options, Notes& notes) {
  Document document;
  document.file = container.file;
  const JsonPlace root(container.json, container.file);
  check_version(root);
  for (const JsonPlace& required : root.entries("extensionsRequired")) {
    const std::string extension = required.string();
    if (!is_supported(extension)) required.not_supported("extension " + extension.substr(0, 80));
  }
  parse_buffers(root, container, options, document, notes);
  parse_accessors(root, options, document);
  parse_materials(root, document, notes);
  parse_meshes(root, document);
  parse_nodes(root, options, document, notes);
  parse_skins(root, document);
  parse_animations(root, document, notes);
  return document;
}

}  // namespace anigen::io::gltf_import
