#include "anigen/io/rigs/assimp_scene.h"

#include <assimp/material.h>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <memory>
#include <new>
#include <stdexcept>
#include <string_view>
#include <system_error>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/guarded_reader.h"
#include "anigen/core/numeric.h"
#include "anigen/io/rigs/assimp.h"
#include "anigen/io/rigs/read_assimp.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/texture_files.h"

namespace anigen::io::assimp_import {

using gltf_import::Component;

namespace {

/// The fields of every structure of a document, once for writing and reading.
template <typename Archive>
class Fields {
 public:
  explicit Fields(Archive& archive) : archive_(archive) {}

  template <typename... Parts>
  void all(Parts&... parts) {
    (one(parts), ...);
  }

 private:
  template <typename T>
  std::enable_if_t<std::is_arithmetic_v<T> || std::is_enum_v<T>> one(T& value) {
    archive_.raw(&value, sizeof value);
  }
  void one(std::string& text) {
    archive_.resize(text, 1);
    archive_.raw(text.data(), text.size());
  }
  template <typename T>
  void one(std::vector<T>& list) {
    archive_.resize(list, 1);  // an element takes a byte at least
    for (T& item : list) one(item);
  }
  void one(std::vector<std::unique_ptr<std::string>>& list) {
    archive_.resize(list, sizeof(std::uint64_t));
    for (std::unique_ptr<std::string>& item : list) {
      if (item == nullptr) item = std::make_unique<std::string>();
      one(*item);
    }
  }
  template <typename A, typename B>
  void one(std::pair<A, B>& pair) {
    all(pair.first, pair.second);
  }
  template <typename Scalar, int R, int C, int O, int MR, int MC>
  void one(Eigen::Matrix<Scalar, R, C, O, MR, MC>& matrix) {
    archive_.raw(matrix.data(), sizeof(Scalar) * static_cast<std::size_t>(matrix.size()));
  }
  void one(Eigen::Quaterniond& rotation) { one(rotation.coeffs()); }
  void one(Transform& t) { all(t.translation, t.rotation, t.scale); }
  void one(gltf_import::Accessor& a) {
    all(a.pointer, a.view, a.offset, a.stride, a.count, a.width, a.component, a.normalized, a.type);
  }
  void one(gltf_import::Node& n) { all(n.name, n.parent, n.mesh, n.skin, n.children, n.local, n.matrix, n.shear); }
  void one(gltf_import::Skin& s) { all(s.pointer, s.joints, s.inverse_bind_accessor); }
  void one(gltf_import::Primitive& p) { all(p.pointer, p.attributes, p.indices, p.material, p.mode, p.has_targets); }
  void one(gltf_import::MeshEntry& m) { all(m.primitives); }
  void one(gltf_import::TextureUse& t) { all(t.texture, t.set, t.linear, t.offset, t.is_transformed); }
  void one(Material& m) { all(m.name, m.base_color, m.image, m.double_sided); }
  void one(gltf_import::MaterialEntry& m) { all(m.material, m.base_color); }
  void one(gltf_import::ImageEntry& i) { all(i.pointer, i.name, i.uri, i.view); }
  void one(gltf_import::AnimationChannel& c) { all(c.pointer, c.node, c.input, c.output, c.path, c.interpolation); }
  void one(gltf_import::AnimationEntry& a) { all(a.name, a.channels); }
  void one(gltf_import::Notes::Entry& e) { all(e.code, e.text, e.count); }
  void one(FileFrame& f) { all(f.up, f.metres); }

  Archive& archive_;
};

class Writer {
 public:
  void raw(const void* bytes, std::size_t count) {
    if (count > 0) bytes_.append(static_cast<const char*>(bytes), count);
  }
  template <typename List>
  void resize(const List& list, std::size_t) {
    const std::uint64_t size = list.size();
    raw(&size, sizeof size);
  }
  std::string take() { return std::move(bytes_); }

 private:
  std::string bytes_;
};

class Reader {
 public:
  explicit Reader(std::string_view bytes) : left_(bytes) {}

  void raw(void* bytes, std::size_t count) {
    if (count > left_.size()) fail();
    if (count > 0) std::memcpy(bytes, left_.data(), count);
    left_.remove_prefix(count);
  }
  template <typename List>
  void resize(List& list, std::size_t least_bytes) {
    std::uint64_t size = 0;
    raw(&size, sizeof size);
    if (size > left_.size() / least_bytes) fail();
    list.resize(static_cast<std::size_t>(size));
  }
  void require_end() const {
    if (!left_.empty()) fail();
  }

 private:
  [[noreturn]] static void fail() { throw Error("a document from another process is damaged"); }
  std::string_view left_;
};

template <typename Archive>
void pass(Archive& archive, gltf_import::Document& d, std::vector<gltf_import::Notes::Entry>& notes) {
  Fields<Archive>(archive).all(d.frame, d.storage, d.accessors, d.nodes, d.top_down, d.in_scene, d.skins, d.meshes,
                               d.materials, d.texture_images, d.images, d.animations, notes);
}

// A document whose arrays DocumentArrays made, with the notes of making it, as bytes for another process of this
// program.
std::string to_bytes(const gltf_import::Document& document, const gltf_import::Notes& notes) {
  Writer writer;
  std::vector<gltf_import::Notes::Entry> entries = notes.entries();
  pass(writer, const_cast<gltf_import::Document&>(document), entries);  // a writer changes nothing
  return writer.take();
}

void from_bytes(std::string_view bytes, gltf_import::Document& document, gltf_import::Notes& notes) {
  Reader reader(bytes);
  std::vector<gltf_import::Notes::Entry> entries;
  pass(reader, document, entries);
  reader.require_end();
  for (const std::unique_ptr<std::string>& stored : document.storage) document.views.push_back({*stored});
  for (const gltf_import::Notes::Entry& entry : entries) {
    if (entry.count > 0)
      notes.tally(entry.code, entry.text, entry.count);
    else
      notes.add(entry.code, entry.text);
  }
}

}  // namespace

int DocumentArrays::add_bytes(std::string bytes) {
  document_.views.push_back({document_.keep(std::move(bytes))});
  return static_cast<int>(document_.views.size()) - 1;
}

int DocumentArrays::add(const void* values, std::size_t bytes, std::size_t item, Component component,
                        const std::string& type, std::size_t width, const std::string& place) {
  gltf_import::Accessor accessor;
  accessor.view = add_bytes(std::string(static_cast<const char*>(values), bytes));
  accessor.pointer = place;
  accessor.stride = item * width;
  accessor.count = bytes / accessor.stride;
  accessor.width = width;
  accessor.component = component;
  accessor.type = type;
  document_.accessors.push_back(std::move(accessor));
  return static_cast<int>(document_.accessors.size()) - 1;
}

namespace {

using Eigen::Matrix4d;

/// Assimp splits the transform of an FBX model into a chain of nodes with these names, one child each.
bool is_helper(const aiNode& node) {
  const std::string_view name(node.mName.C_Str());
  return name.find("_$AssimpFbx$_") != std::string_view::npos && node.mNumMeshes == 0 && node.mNumChildren == 1;
}

/// An axis of the file as metadata tell it: number and sign.
Eigen::RowVector3d axis(const aiScene& scene, const char* name, int number, int sign) {
  std::int32_t told = number, told_sign = sign;
  if (scene.mMetaData != nullptr) {
    scene.mMetaData->Get(name, told);
    scene.mMetaData->Get(std::string(name) + "Sign", told_sign);
  }
  Eigen::RowVector3d row = Eigen::RowVector3d::Zero();
  if (told >= 0 && told <= 2) row[told] = told_sign < 0 ? -1.0 : 1.0;
  return row;
}

/// FBX: to Y up and metres. Its axes are right, up and front; a file that contradicts itself is taken as Y up.
/// @param frame set to what the file says
Matrix4d fbx_root(const aiScene& scene, FileFrame& frame) {
  Eigen::Matrix3d turn;
  turn.row(0) = axis(scene, "CoordAxis", 0, 1);
  turn.row(1) = axis(scene, "UpAxis", 1, 1);
  turn.row(2) = axis(scene, "FrontAxis", 2, 1);
  if (!(std::abs(turn.determinant()) > 0.5)) turn.setIdentity();
  double unit = 1.0;  // centimetres
  if (scene.mMetaData != nullptr) {
    float single = 1.0f;
    if (!scene.mMetaData->Get("UnitScaleFactor", unit) && scene.mMetaData->Get("UnitScaleFactor", single))
      unit = static_cast<double>(single);
  }
  if (!(unit > 0.0) || !std::isfinite(unit)) unit = 1.0;
  for (int k = 0; k < 3; ++k) {
    if (turn(1, k) != 0.0) frame.up = static_cast<char>('X' + k);
  }
  frame.metres = 0.01 * unit;
  Matrix4d result = Matrix4d::Identity();
  result.topLeftCorner<3, 3>() = frame.metres * turn;
  return result;
}

}  // namespace

Matrix4d to_matrix(const aiMatrix4x4& m) {
  Matrix4d result;
  for (unsigned r = 0; r < 4; ++r) {
    for (unsigned c = 0; c < 4; ++c) result(r, c) = static_cast<double>(m[r][c]);
  }
  return result;
}

NodeTable add_nodes(const aiScene& scene, bool is_fbx, gltf_import::Document& document) {
  struct Open {
    const aiNode* node;
    int parent;
    std::vector<const aiNode*> above;  ///< helpers since the parent
  };
  NodeTable table;
  std::vector<Open> open;
  open.push_back({scene.mRootNode, -1, {}});
  while (!open.empty()) {
    Open one = std::move(open.back());
    open.pop_back();
    int parent = one.parent;
    one.above.push_back(one.node);
    const bool folded = is_fbx && one.parent >= 0 && is_helper(*one.node);
    if (!folded) {
      parent = static_cast<int>(document.nodes.size());
      gltf_import::Node node;
      node.name = one.node->mName.C_Str();
      node.parent = one.parent;
      node.matrix = Matrix4d::Identity();
      for (const aiNode* link : one.above) node.matrix = Matrix4d(node.matrix * to_matrix(link->mTransformation));
      if (is_fbx && one.parent < 0) node.matrix = fbx_root(scene, document.frame);
      node.matrix.row(3) = Eigen::RowVector4d(0, 0, 0, 1);
      node.local = decompose(node.matrix, &node.shear);
      if (!node.matrix.allFinite() || !std::isfinite(node.matrix.squaredNorm()) || !node.local.scale.allFinite() ||
          !node.local.rotation.coeffs().allFinite())
        throw InputError(document.file, "node " + node.name, "its transform is not finite");
      if (one.parent >= 0) document.nodes[at(one.parent)].children.push_back(parent);
      table.node.push_back(one.node);
      table.by_name.emplace(node.name, parent);
      document.nodes.push_back(std::move(node));
      document.top_down.push_back(parent);
      document.in_scene.push_back(1);
      table.chain.push_back(std::move(one.above));
      one.above.clear();
    }
    for (unsigned c = one.node->mNumChildren; c-- > 0;)  // the first child is taken next
      open.push_back({one.node->mChildren[c], parent, one.above});
  }
  return table;
}

void add_mesh_node(gltf_import::Document& document, int parent, int mesh, int skin) {
  gltf_import::Node node;
  const int number = static_cast<int>(document.nodes.size());
  gltf_import::Node& above = document.nodes[at(parent)];
  node.name = above.name;
  node.parent = parent;
  node.mesh = mesh;
  node.skin = skin;
  node.matrix = Matrix4d::Identity();
  above.children.push_back(number);
  document.nodes.push_back(std::move(node));
  document.top_down.push_back(number);
  document.in_scene.push_back(1);
}

namespace {

namespace fs = std::filesystem;

/// Characters that a uri must escape.
std::string percent_encoded(const std::string& path) {
  constexpr char kDigits[] = "0123456789ABCDEF";
  std::string uri;
  for (const char c : path) {
    const auto byte = static_cast<unsigned char>(c);
    if (byte <= 0x20 || c == '%' || c == '\\' || c == ':' || byte == 0x7F) {
      uri += '%';
      uri += kDigits[byte >> 4];
      uri += kDigits[byte & 15];
    } else {
      uri += c;
    }
  }
  return uri;
}

class Textures {
 public:
  Textures(const aiScene& scene, const fs::path& folder, gltf_import::Document& document)
      : scene_(scene), folder_(folder), document_(document) {}

  /// @return its number among the document's textures, or -1
  int get(const std::string& path) {
    const auto [known, is_new] = known_.try_emplace(path, -1);
    if (is_new) known->second = add(path);
    return known->second;
  }

 private:
  int add(const std::string& path) {
    gltf_import::ImageEntry image;
    image.pointer = "texture " + path;
    const aiTexture* embedded = scene_.GetEmbeddedTexture(path.c_str());
    if (embedded != nullptr) {
      image.name = fs::path(embedded->mFilename.C_Str()).stem().string();
      // Raw pixels (height above 0) are no encoded picture: the stage that reads images says so.
      if (embedded->mHeight == 0 && embedded->pcData != nullptr) {
        image.view = DocumentArrays(document_).add_bytes(
            std::string(reinterpret_cast<const char*>(embedded->pcData), embedded->mWidth));
      }
    } else {
      const fs::path found = find_named_file(path, folder_);
      if (found.empty()) return -1;
      image.name = found.stem().string();
      image.uri = percent_encoded(found.generic_string());
    }
    document_.images.push_back(std::move(image));
    document_.texture_images.push_back(static_cast<int>(document_.images.size()) - 1);
    return static_cast<int>(document_.texture_images.size()) - 1;
  }

  const aiScene& scene_;
  const fs::path& folder_;
  gltf_import::Document& document_;
  std::map<std::string, int> known_;
};

bool is_color(const aiColor4D& color) {
  for (const float c : {color.r, color.g, color.b}) {
    if (!(c >= 0.0f && c <= 1.0f)) return false;
  }
  return true;
}

}  // namespace

void add_materials(const aiScene& scene, const fs::path& folder, gltf_import::Document& document) {
  Textures textures(scene, folder, document);
  for (unsigned m = 0; m < scene.mNumMaterials; ++m) {
    const aiMaterial& from = *scene.mMaterials[m];
    gltf_import::MaterialEntry to;
    aiString text;
    if (from.Get(AI_MATKEY_NAME, text) == aiReturn_SUCCESS) to.material.name = text.C_Str();
    for (const aiTextureType type : {aiTextureType_BASE_COLOR, aiTextureType_DIFFUSE}) {
      if (to.base_color.texture < 0 && from.GetTexture(type, 0, &text) == aiReturn_SUCCESS && text.length > 0)
        to.base_color.texture = textures.get(text.C_Str());
    }
    // A texture replaces the colour in these formats, where glTF multiplies the two.
    aiColor4D color(1.0f, 1.0f, 1.0f, 1.0f);
    const bool has_color = from.Get(AI_MATKEY_BASE_COLOR, color) == aiReturn_SUCCESS ||
                           from.Get(AI_MATKEY_COLOR_DIFFUSE, color) == aiReturn_SUCCESS;
    if (has_color && to.base_color.texture < 0 && is_color(color))
      to.material.base_color = Eigen::Vector4f(color.r, color.g, color.b, 1.0f);
    // Exporters disagree about what 0 means; nobody wants an invisible asset.
    float opacity = 1.0f;
    if (from.Get(AI_MATKEY_OPACITY, opacity) == aiReturn_SUCCESS && opacity > 0.0f && opacity <= 1.0f)
      to.material.base_color.w() = opacity;
    document.materials.push_back(std::move(to));
  }
}

}  // namespace anigen::io::assimp_import

namespace anigen::io {

namespace {

namespace fs = std::filesystem;

constexpr const char* kTooLarge = "reading it needs more memory than there is";

/// Many times what sound files take.
constexpr double kSeconds = 30.0, kSecondsPerMebibyte = 1.0;
constexpr std::uint64_t kMemory = std::uint64_t{8} << 30, kMemoryPerByte = 32;

std::string read_with_assimp(const fs::path& path, const ImportOptions& options) {
  Assimp::Importer importer;
  gltf_import::Notes notes;
  gltf_import::Document document;
  document.file = path.string();
  const aiScene& scene = assimp_import::load(importer, path, options, document.frame);
  const bool is_fbx = lower_extension(path) == ".fbx";
  const assimp_import::NodeTable nodes = assimp_import::add_nodes(scene, is_fbx, document);
  assimp_import::add_animations(scene, nodes, document);
  assimp_import::add_meshes(scene, nodes, is_fbx, document, notes);
  assimp_import::add_materials(scene, path.parent_path(), document);
  return assimp_import::to_bytes(document, notes);
}

}  // namespace

ImportedAsset read_assimp(const fs::path& path, const ImportOptions& options) {
  const std::string file = path.string();
  try {
    ProcessLimits limits;
    std::error_code error;
    const std::uintmax_t bytes = fs::file_size(path, error);
    const std::uint64_t size = error ? 0 : static_cast<std::uint64_t>(bytes);
    limits.cpu_seconds = kSeconds + kSecondsPerMebibyte * static_cast<double>(size) / (1 << 20);
    limits.more_memory = kMemory + kMemoryPerByte * size;
    limits.sandbox = SandboxRights();  // it reads, and answers by the pipe
    std::string bytes_of_document =
        read_guarded(file, "Assimp cannot read it: it %; the file is damaged or hostile: export it again, best as .glb",
                     limits, [&] { return read_with_assimp(path, options); });
    gltf_import::Notes notes;
    gltf_import::Document document;
    document.file = file;
    assimp_import::from_bytes(bytes_of_document, document, notes);
    bytes_of_document = {};
    return gltf_import::document_asset(document, path, options, notes);
  } catch (const std::bad_alloc&) {
    throw InputError(file, "", kTooLarge);
  } catch (const std::length_error&) {
    throw InputError(file, "", kTooLarge);
  }
}

}  // namespace anigen::io
