#include "anigen/io/three_mf.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "anigen/core/error.h"
#include "anigen/io/arrays/npz.h"
#include "anigen/io/obj.h"

namespace anigen::io {

namespace {

constexpr std::string_view kXmlSpaces = " \t\r\n";
constexpr std::uint64_t kMostModelBytes = std::uint64_t{4} << 30;
constexpr int kDeepestComponents = 64;

/// One tag of an XML text: its name without a prefix, its attributes, whether it closes.
struct XmlTag {
  std::string_view name, attributes;
  bool closes = false;  ///< </name>
  bool empty = false;   ///< <name/>
};

/// Tags of an XML text in order; text between them, comments and processing instructions are passed over.
class XmlTags {
 public:
  XmlTags(std::string_view text, std::string file, std::string member)
      : text_(text), file_(std::move(file)), member_(std::move(member)) {
    if (text_.substr(0, 2) == "\xFF\xFE" || text_.substr(0, 2) == "\xFE\xFF")
      throw NotSupportedError(file_, member_, "text in UTF-16");
  }

  /// @return false at the end
  bool next(XmlTag& tag) {
    while (true) {
      at_ = text_.find('<', at_);
      if (at_ == std::string_view::npos) return false;
      if (skipped("<!--", "-->") || skipped("<?", "?>") || skipped("<![CDATA[", "]]>")) continue;
      if (text_.substr(at_, 2) == "<!") throw NotSupportedError(file_, place(), "a DOCTYPE");
      break;
    }
    const std::size_t end = end_of_tag();
    std::string_view inside = text_.substr(at_ + 1, end - at_ - 1);
    at_ = end + 1;
    tag = {};
    tag.closes = !inside.empty() && inside.front() == '/';
    if (tag.closes) inside.remove_prefix(1);
    tag.empty = !inside.empty() && inside.back() == '/';
    if (tag.empty) inside.remove_suffix(1);
    const std::size_t name = std::min(inside.find_first_of(kXmlSpaces), inside.size());
    tag.name = inside.substr(0, name);
    tag.attributes = inside.substr(name);
    const std::size_t prefix = tag.name.find(':');
    if (prefix != std::string_view::npos) tag.name.remove_prefix(prefix + 1);
    return true;
  }

  std::string place() const { return member_ + ", byte " + std::to_string(at_); }
  const std::string& file() const { return file_; }

 private:
  bool skipped(std::string_view opening, std::string_view closing) {
    if (text_.substr(at_, opening.size()) != opening) return false;
    const std::size_t end = text_.find(closing, at_ + opening.size());
    if (end == std::string_view::npos) throw InputError(file_, place(), "the file is cut short");
    at_ = end + closing.size();
    return true;
  }

  std::size_t end_of_tag() const {
    char quote = 0;
    for (std::size_t i = at_ + 1; i < text_.size(); ++i) {
      const char c = text_[i];
      if (quote != 0) {
        if (c == quote) quote = 0;
      } else if (c == '"' || c == '\'') {
        quote = c;
      } else if (c == '>') {
        return i;
      }
    }
    throw InputError(file_, place(), "the file is cut short");
  }

  std::string_view text_;
  std::string file_, member_;
  std::size_t at_ = 0;
};

/// The value of an attribute, any prefix of whose name is left out; empty without it.
std::string_view xml_attribute(std::string_view attributes, std::string_view name) {
  std::size_t at = 0;
  while (true) {
    at = attributes.find_first_not_of(kXmlSpaces, at);
    const std::size_t equals = at == std::string_view::npos ? at : attributes.find('=', at);
    if (equals == std::string_view::npos) return {};
    const std::size_t opening = attributes.find_first_not_of(kXmlSpaces, equals + 1);
    if (opening == std::string_view::npos) return {};
    const std::size_t closing = attributes.find(attributes[opening], opening + 1);
    if (closing == std::string_view::npos) return {};
    std::string_view key = attributes.substr(at, equals - at);
    while (!key.empty() && kXmlSpaces.find(key.back()) != std::string_view::npos) key.remove_suffix(1);
    const std::size_t prefix = key.find(':');
    if (prefix != std::string_view::npos) key.remove_prefix(prefix + 1);
    if (key == name) return attributes.substr(opening + 1, closing - opening - 1);
    at = closing + 1;
  }
}

struct PlacedObject {
  std::int64_t object = 0;
  Eigen::Affine3d placed = Eigen::Affine3d::Identity();
};

struct MeshObject {
  std::vector<Eigen::Vector3d> vertices;
  std::vector<Triangle> faces;
  std::vector<PlacedObject> components;
  bool support = false;
};

/// Reads the model part and puts its build together.
class ThreeMfModel {
 public:
  ThreeMfModel(std::string_view text, const std::string& file, const std::string& member, const ThreeMfLimits& limits)
      : tags_(text, file, member), limits_(limits) {
    read();
    if (build_.empty()) throw InputError(file, member, "its build names no object");
  }

  Mesh built() {
    for (const PlacedObject& item : build_) add(item, Eigen::Affine3d::Identity(), 0);
    if (mesh_.faces.empty()) throw InputError(tags_.file(), "", "its build has no triangle");
    return std::move(mesh_);
  }

 private:
  [[noreturn]] void fail(const std::string& problem) const { throw InputError(tags_.file(), tags_.place(), problem); }

  double number(const XmlTag& tag, const char* name) const {
    double value = 0.0;
    const std::string_view word = xml_attribute(tag.attributes, name);
    if (!parse_number(word, value) || !std::isfinite(value))
      fail(std::string(tag.name) + "." + name + " is no finite number: '" + std::string(word.substr(0, 40)) + "'");
    return value;
  }

  std::int64_t whole(const XmlTag& tag, const char* name) const {
    const std::string_view word = xml_attribute(tag.attributes, name);
    std::int64_t value = -1;
    const auto [end, problem] = std::from_chars(word.data(), word.data() + word.size(), value);
    if (problem != std::errc() || end != word.data() + word.size() || value < 0)
      fail(std::string(tag.name) + "." + name + " is no whole number: '" + std::string(word.substr(0, 40)) + "'");
    return value;
  }

  /// Twelve numbers, the rows of a matrix that points are multiplied with from the left.
  PlacedObject placed(const XmlTag& tag) const {
    if (!xml_attribute(tag.attributes, "path").empty())
      throw NotSupportedError(tags_.file(), tags_.place(),
                              "parts in other files of the archive (production extension)");
    PlacedObject component;
    component.object = whole(tag, "objectid");
    std::string_view words = xml_attribute(tag.attributes, "transform");
    if (words.empty()) return component;
    for (int k = 0; k < 12; ++k) {
      words.remove_prefix(std::min(words.find_first_not_of(kXmlSpaces), words.size()));
      const std::size_t length = std::min(words.find_first_of(kXmlSpaces), words.size());
      double value = 0.0;
      if (!parse_number(words.substr(0, length), value) || !std::isfinite(value))
        fail(std::string(tag.name) + ".transform needs twelve finite numbers");
      component.placed(k % 3, k / 3) = value;
      words.remove_prefix(length);
    }
    return component;
  }

  void read_unit(const XmlTag& tag) {
    static const std::map<std::string_view, double> kMetres = {{"micron", 1e-6},     {"millimeter", 1e-3},
                                                               {"centimeter", 1e-2}, {"inch", 0.0254},
                                                               {"foot", 0.3048},     {"meter", 1.0}};
    const std::string_view unit = xml_attribute(tag.attributes, "unit");
    if (unit.empty()) return;
    const auto known = kMetres.find(unit);
    if (known == kMetres.end()) fail("unknown unit '" + std::string(unit.substr(0, 40)) + "'");
    metres_ = known->second;
  }

  void read() {
    XmlTag tag;
    MeshObject* object = nullptr;
    while (tags_.next(tag)) {
      if (tag.closes) {
        if (tag.name == "object") object = nullptr;
        continue;
      }
      if (tag.name == "model") read_unit(tag);
      if (tag.name == "item") build_.push_back(placed(tag));
      if (tag.name == "object") {
        object = &objects_[whole(tag, "id")];
        object->support = xml_attribute(tag.attributes, "type") == "support";
        if (tag.empty) object = nullptr;
      }
      if (object == nullptr) continue;
      if (tag.name == "component") object->components.push_back(placed(tag));
      if (tag.name == "vertex") {
        if (++vertices_ > limits_.max_vertices) fail("more vertices than the limit");
        object->vertices.emplace_back(number(tag, "x"), number(tag, "y"), number(tag, "z"));
      }
      if (tag.name == "triangle") {
        if (++faces_ > limits_.max_faces) fail("more triangles than the limit");
        Triangle face{};
        for (std::size_t k = 0; k < 3; ++k) {
          static constexpr std::array<const char*, 3> kCorners = {"v1", "v2", "v3"};
          const std::int64_t corner = whole(tag, kCorners[k]);
          if (static_cast<std::uint64_t>(corner) >= object->vertices.size())
            fail("a triangle names vertex " + std::to_string(corner) + " of " +
                 std::to_string(object->vertices.size()));
          face[k] = static_cast<std::int32_t>(corner);
        }
        object->faces.push_back(face);
      }
    }
  }

  void add(const PlacedObject& item, const Eigen::Affine3d& outer, int depth) {
    const std::string name = "object " + std::to_string(item.object);
    if (depth > kDeepestComponents)
      throw InputError(tags_.file(), name, "components are nested deeper than 64, or contain themselves");
    if (++placements_ > kMostPlacements)
      throw InputError(tags_.file(), name, "components place more than a million objects");
    const auto found = objects_.find(item.object);
    if (found == objects_.end()) throw InputError(tags_.file(), name, "is named, but not there");
    const MeshObject& object = found->second;
    if (object.support) return;
    const Eigen::Affine3d place = outer * item.placed;
    if (mesh_.vertices.size() + object.vertices.size() > limits_.max_vertices ||
        mesh_.faces.size() + object.faces.size() > limits_.max_faces)
      throw InputError(tags_.file(), name, "the build has more vertices or triangles than the limit");
    const std::size_t first = mesh_.vertices.size();
    for (const Eigen::Vector3d& vertex : object.vertices)
      mesh_.vertices.push_back((metres_ * (place * vertex)).cast<float>());
    // A mirroring placement turns triangles inside out.
    const bool mirrored = place.linear().determinant() < 0.0;
    for (Triangle face : object.faces) {
      if (face[0] == face[1] || face[1] == face[2] || face[0] == face[2]) continue;
      for (std::int32_t& corner : face) corner = face_index(first + static_cast<std::size_t>(corner), tags_.file());
      if (mirrored) std::swap(face[1], face[2]);
      mesh_.faces.push_back(face);
    }
    for (const PlacedObject& component : object.components) add(component, place, depth + 1);
  }

  static constexpr std::size_t kMostPlacements = 1'000'000;

  XmlTags tags_;
  ThreeMfLimits limits_;
  double metres_ = 1e-3;  // the format's default is millimetres
  std::map<std::int64_t, MeshObject> objects_;
  std::vector<PlacedObject> build_;
  std::size_t vertices_ = 0, faces_ = 0, placements_ = 0;
  Mesh mesh_;
};

/// Name of the model's part in the archive: the target of the relationship of its type, else the usual one.
std::string model_member(const ZipReader& archive) {
  const ZipMember* relations = archive.find("_rels/.rels");
  if (relations != nullptr) {
    const std::string text = archive.read(*relations);
    XmlTags tags(text, archive.file(), relations->name);
    XmlTag tag;
    while (tags.next(tag)) {
      if (tag.name != "Relationship" || tag.closes) continue;
      const std::string_view type = xml_attribute(tag.attributes, "Type");
      std::string_view target = xml_attribute(tag.attributes, "Target");
      if (type.size() < 8 || type.substr(type.size() - 8) != "/3dmodel") continue;
      while (!target.empty() && target.front() == '/') target.remove_prefix(1);
      return std::string(target);
    }
  }
  return "3D/3dmodel.model";
}

}  // namespace

Mesh read_three_mf(const std::filesystem::path& path, const ThreeMfLimits& limits) {
  ZipLimits zip;
  zip.max_member_bytes = kMostModelBytes;
  const ZipReader archive(path, zip);
  const std::string name = model_member(archive);
  const ZipMember* member = archive.find(name);
  if (member == nullptr) throw InputError(path.string(), name, "is not in the archive: there is no model");
  const std::string text = archive.read(*member);
  return ThreeMfModel(text, path.string(), name, limits).built();
}

}  // namespace anigen::io
