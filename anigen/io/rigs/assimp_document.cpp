#include "anigen/io/rigs/assimp_document.h"

#include <cstring>
#include <memory>
#include <type_traits>
#include <utility>

#include "anigen/core/error.h"

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
  void one(gltf_import::ImageEntry& i) { all(i.pointer, i.name, i.mime_type, i.uri, i.view); }
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

}  // namespace

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
  for (const std::unique_ptr<std::string>& stored : document.storage) {
    gltf_import::BufferView view;
    view.bytes = *stored;
    document.views.push_back(view);
  }
  for (const gltf_import::Notes::Entry& entry : entries) {
    if (entry.count > 0)
      notes.tally(entry.code, entry.text, entry.count);
    else
      notes.add(entry.code, entry.text);
  }
}

int DocumentArrays::add_bytes(std::string bytes) {
  document_.storage.push_back(std::make_unique<std::string>(std::move(bytes)));
  gltf_import::BufferView view;
  view.bytes = *document_.storage.back();
  document_.views.push_back(view);
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

int DocumentArrays::add(const std::vector<float>& values, const std::string& type, std::size_t width,
                        const std::string& place) {
  return add(values.data(), 4 * values.size(), 4, Component::kF32, type, width, place);
}

int DocumentArrays::add(const std::vector<std::uint16_t>& values, const std::string& type, std::size_t width,
                        const std::string& place) {
  return add(values.data(), 2 * values.size(), 2, Component::kU16, type, width, place);
}

int DocumentArrays::add(const std::vector<std::uint32_t>& values, const std::string& type, std::size_t width,
                        const std::string& place) {
  return add(values.data(), 4 * values.size(), 4, Component::kU32, type, width, place);
}

}  // namespace anigen::io::assimp_import
