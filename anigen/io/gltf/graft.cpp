#include "anigen/io/gltf/graft.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>
#include <new>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/core/files.h"
#include "anigen/core/numeric.h"
#include "anigen/geometry/nearest_point.h"
#include "anigen/io/gltf/accessors.h"
#include "anigen/io/gltf/document.h"
#include "anigen/io/gltf/export.h"
#include "anigen/io/gltf/graft_file.h"
#include "anigen/io/gltf/graft_source.h"

namespace anigen::io {

namespace gltf_import {

namespace {

using Eigen::Matrix4d;

/// The rows for the vertices of one primitive.
struct PrimitiveRows {
  int primitive = 0;
  std::size_t first = 0, count = 0;
  std::vector<std::size_t> rows;  // empty: `count` from `first` on
  std::size_t row(std::size_t vertex) const { return rows.empty() ? first + vertex : rows[vertex]; }
};

/// A node whose mesh gets weights.
struct BoundNode {
  int node = 0;
  std::size_t skin = 0;  // of the planned ones
  std::vector<PrimitiveRows> primitives;
};

/// A skin of the copy: of the file, perhaps with joints added, or new.
struct PlannedSkin {
  int old = -1;  // of the file
  Matrix4d to_bind;
  std::vector<int> joints;   // per entry
  std::vector<int> entries;  // per joint, or -1
  int index = -1;            // in the copy

  int entry(int joint) {
    int& known = entries[at(joint)];
    if (known < 0) {
      known = static_cast<int>(joints.size());
      joints.push_back(joint);
    }
    return known;
  }
};

class Grafter {
 public:
  /// @param own as own_joints() has it
  Grafter(const GraftSource& source, const Skeleton& skeleton, const SkinWeights& skin, const std::vector<int>& own,
          const GraftOptions& options)
      : source_(source),
        document_(source.document),
        is_own_(!own.empty()),
        skeleton_(is_own_ ? with_further_joints(source.rig.skeleton, skeleton, own) : skeleton),
        skin_(limit_influences(skin, options.influences)),
        options_(options),
        file_(source.container, source.options),
        node_of_joint_(skeleton_.size(), -1) {
    if (!is_own_) return;
    for (Influence& influence : skin_.influences) influence.joint = own[at(influence.joint)];
    for (std::size_t n = 0; n < document_.nodes.size(); ++n) {
      const int joint = source.rig.joint_of_node[n];
      if (joint >= 0) node_of_joint_[at(joint)] = static_cast<int>(n);
    }
  }

  /// @param own as own_joints() has it
  std::string graft(bool binary, const std::vector<int>& own, GraftReport& report) {
    choose_nodes();
    add_joints(own);
    add_skins();
    for (const BoundNode& bound : bound_) bind_node(bound, report);
    add_extensions(own);
    file_.embed_files(notes_);
    report = {is_own_, bound_.size(), report.copied_meshes, notes_.take()};
    return file_.bytes(binary);
  }

 private:
  std::string pointer(int node) const { return "/nodes/" + std::to_string(node); }
  [[noreturn]] void not_supported(int node, const std::string& what) const {
    const std::string& name = document_.nodes[at(node)].name;
    throw NotSupportedError(document_.file, pointer(node), what + (name.empty() ? "" : " (node '" + name + "')"));
  }

  void choose_nodes() {
    std::map<int, std::vector<const VertexRange*>> ranges;
    for (const VertexRange& range : source_.merged.ranges) ranges[range.node].push_back(&range);
    for (const auto& [node, parts] : ranges) {
      if (!stays(node, parts)) choose_node(node, parts);
    }
    if (bound_.empty() && !is_own_)
      throw InputError(document_.file, "/nodes", "every mesh is collapsed by the transform of its node");
  }

  bool stays(int node, const std::vector<const VertexRange*>& parts) {
    const VertexRange& first = *parts.front();
    const Eigen::Matrix3d linear = first.to_bind.topLeftCorner<3, 3>();
    const double scale = linear.norm();
    if (!(std::abs(linear.determinant()) > 1e-12 * scale * scale * scale)) {
      notes_.tally("collapsed_node", "nodes whose transform collapses their mesh stayed without a skin");
      return true;
    }
    // A mesh without a joint above it rests, as does the root that the importer has made.
    const int above = source_.rig.nearest_joint[at(node)], joint = std::max(above, 0);
    if (!is_own_ || (above < 0 && node_of_joint_[0] >= 0)) return false;
    return std::all_of(parts.begin(), parts.end(), [&](const VertexRange* part) {
      if (part->is_skinned) return false;
      for (std::size_t v = part->first; v < part->first + part->count; ++v) {
        if (skin_.row_size(v) != 1 || skin_.row(v)->joint != joint) return false;
      }
      return true;
    });
  }

  void choose_node(int node, const std::vector<const VertexRange*>& parts) {
    const VertexRange& first = *parts.front();
    const JsonPlace place(file_.json()["nodes"][at(node)], document_.file, pointer(node));
    if (place.extension("EXT_mesh_gpu_instancing")) not_supported(node, "a skin for a mesh instanced on the GPU");
    for (const VertexRange* part : parts) {
      if ((part->to_bind - first.to_bind).norm() > 1e-9 * first.to_bind.norm())
        not_supported(node, "a skin for a node whose old skin only some of its primitives have weights for");
      if (!is_own_ && part->deviation > source_.noise)
        not_supported(node, "a new skeleton for a mesh whose skins disagree about the bind pose");
    }
    BoundNode bound;
    bound.node = node;
    const Matrix4d to_bind = is_own_ ? first.to_bind : Matrix4d(options_.placement * first.to_bind);
    bound.skin = planned_skin(is_own_ && first.is_skinned ? document_.nodes[at(node)].skin : -1, to_bind);
    const std::vector<Primitive>& primitives = document_.meshes[at(first.mesh)].primitives;
    for (std::size_t p = 0; p < primitives.size(); ++p) {
      const auto own =
          std::find_if(parts.begin(), parts.end(), [p](const VertexRange* part) { return at(part->primitive) == p; });
      PrimitiveRows rows;
      if (own != parts.end()) {
        rows.first = (*own)->first;
        rows.count = (*own)->count;
      } else if (primitives[p].attribute("POSITION") >= 0) {
        rows = nearest_rows(primitives[p], first);
      } else {
        continue;  // shows nothing
      }
      rows.primitive = static_cast<int>(p);
      bound.primitives.push_back(std::move(rows));
    }
    for (const PrimitiveRows& rows : bound.primitives) {
      for (std::size_t i = 0; i < rows.count; ++i) {
        const std::size_t v = rows.row(i);
        for (std::size_t k = 0; k < skin_.row_size(v); ++k) skins_[bound.skin].entry(skin_.row(v)[k].joint);
      }
    }
    bound_.push_back(std::move(bound));
  }

  /// Points and lines have no vertices in the merged mesh.
  PrimitiveRows nearest_rows(const Primitive& primitive, const VertexRange& beside) {
    const int accessor = primitive.attribute("POSITION");
    if (document_.accessors[at(accessor)].type != "VEC3")
      throw InputError(document_.file, primitive.pointer + "/attributes/POSITION", "expected VEC3");
    if (!nearest_) nearest_.emplace(in_double(source_.merged.mesh.vertices));
    const std::vector<double> positions = read_doubles(document_, accessor);
    PrimitiveRows rows;
    rows.count = positions.size() / 3;
    for (std::size_t v = 0; v < rows.count; ++v) {
      const Eigen::Vector3d p = Eigen::Map<const Eigen::Vector3d>(positions.data() + 3 * v);
      const Eigen::Vector3d placed = (beside.to_bind * p.homogeneous()).head<3>();
      const bool is_usable = placed.allFinite() && placed.cwiseAbs().maxCoeff() < 1e100;
      rows.rows.push_back(is_usable ? nearest_->nearest(placed).index : beside.first);
    }
    return rows;
  }

  /// @param old skin of the file, or -1 for a new one
  std::size_t planned_skin(int old, const Matrix4d& to_bind) {
    for (std::size_t s = 0; s < skins_.size(); ++s) {
      if (skins_[s].old == old && (old >= 0 || skins_[s].to_bind == to_bind)) return s;
    }
    PlannedSkin skin{old, to_bind, {}, std::vector<int>(skeleton_.size(), -1)};
    if (old >= 0) {
      for (const int joint : source_.bindings[at(old)].joints) skin.entry(joint);
    } else if (!is_own_) {
      for (std::size_t j = 0; j < skeleton_.size(); ++j) skin.entry(static_cast<int>(j));
    }
    skins_.push_back(std::move(skin));
    return skins_.size() - 1;
  }

  void add_joints(const std::vector<int>& own) {
    if (is_own_) {
      add_further_joints();
      add_made_root();
      return rename(own);
    }
    const int carrier = common_carrier();
    if (carrier >= 0 && options_.placement != Matrix4d::Identity())
      not_supported(carrier, "another size or place of meshes that animation '" + animation_of(carrier) + "' moves");
    const std::size_t base = file_.count("nodes");
    std::vector<Json> nodes;
    for (std::size_t j = 0; j < skeleton_.size(); ++j) {
      node_of_joint_[j] = static_cast<int>(base + j);
      nodes.push_back(joint_node(skeleton_.names[j], j == 0 ? root_below(carrier) : skeleton_.rest[j]));
      if (j > 0) nodes[at(skeleton_.parents[j])]["children"].push_back(base + j);
    }
    for (const Json& node : nodes) file_.add("nodes", text_of(node));
    if (carrier < 0) return show(node_of_joint_[0]);
    file_.add_children(at(carrier), {std::to_string(node_of_joint_[0])});
  }

  /// Nodes of joints that the file's own skeleton gets, below those of their parents.
  void add_further_joints() {
    const std::size_t first = source_.rig.skeleton.size(), base = file_.count("nodes");
    std::vector<Json> nodes;
    std::map<int, std::vector<std::string>> children;  // of a node of the file
    for (std::size_t j = first; j < skeleton_.size(); ++j) {
      const int parent = skeleton_.parents[j], above = node_of_joint_[at(parent)];
      node_of_joint_[j] = static_cast<int>(base + nodes.size());
      nodes.push_back(joint_node(skeleton_.names[j], skeleton_.rest[j]));
      if (at(parent) >= first)
        nodes[at(parent) - first]["children"].push_back(node_of_joint_[j]);
      else if (above >= 0)
        children[above].push_back(std::to_string(node_of_joint_[j]));
      else
        below_made_root_.push_back(node_of_joint_[j]);
      parent_of_added_.push_back(above);
    }
    for (const Json& node : nodes) file_.add("nodes", text_of(node));
    for (const auto& [node, added] : children) file_.add_children(at(node), added);
  }

  /// The node above a joint's node that is above all others.
  int top_node(int node) const {
    while (node >= 0) {
      const bool is_of_file = at(node) < document_.nodes.size();
      const std::size_t added = is_of_file ? 0 : at(node) - document_.nodes.size();
      if (!is_of_file && added >= parent_of_added_.size()) return node;  // the made root
      const int above = is_of_file ? document_.nodes[at(node)].parent : parent_of_added_[added];
      if (above < 0) return node;
      node = above;
    }
    return node;
  }

  void rename(const std::vector<int>& own) {
    for (std::size_t j = 0; j < options_.names.size(); ++j) {
      const int node = node_of_joint_[at(own[j])];
      if (node < 0 || at(node) >= document_.nodes.size() || document_.nodes[at(node)].name == options_.names[j])
        continue;
      file_.text().set(file_.original("nodes", at(node)), "name", text_of(Json(options_.names[j])));
    }
  }

  void add_extensions(const std::vector<int>& own) {
    if (!options_.extensions) return;
    std::vector<int> nodes = node_of_joint_;
    for (std::size_t j = 0; j < own.size(); ++j) nodes[j] = node_of_joint_[at(own[j])];
    file_.add_extensions(options_.extensions(nodes));
  }

  /// The importer's own root above several others is no node of the file. It gets one where weights name it.
  void add_made_root() {
    const bool is_used = std::any_of(skins_.begin(), skins_.end(), [&](const PlannedSkin& skin) {
      return std::any_of(skin.joints.begin(), skin.joints.end(), [&](int j) { return node_of_joint_[at(j)] < 0; });
    });
    const bool is_made = is_used || !below_made_root_.empty();
    if (is_made) {
      Json root = joint_node(skeleton_.names[0], root_below(-1));
      if (!below_made_root_.empty()) root["children"] = below_made_root_;
      node_of_joint_[0] = file_.add("nodes", text_of(root));
      for (const int node : below_made_root_) parent_of_added_[at(node) - document_.nodes.size()] = node_of_joint_[0];
    }
    if (gather_roots()) return;
    if (is_made) show(node_of_joint_[0]);
  }

  bool is_longer(const PlannedSkin& skin) const {
    return skin.old < 0 || skin.joints.size() != document_.skins[at(skin.old)].joints.size();
  }

  /// Joints of a skin need a common root (glTF 2.0, section 3.7.3.1). Where a skin got joints below another root of the
  /// scene, one node without transform goes above these roots. @return whether it did
  bool gather_roots() {
    std::set<int> roots;
    for (const PlannedSkin& skin : skins_) {
      std::set<int> above;
      for (const int joint : skin.joints) {
        above.insert(top_node(node_of_joint_[at(joint)]));
      }
      if (is_longer(skin) && above.size() > 1) roots.insert(above.begin(), above.end());
    }
    const Json& json = file_.json();
    if (roots.empty() || !json.contains("scenes")) return false;
    const auto of_file = static_cast<std::size_t>(
        std::distance(roots.begin(), roots.lower_bound(static_cast<int>(document_.nodes.size()))));
    std::vector<std::string> lists;  // of nodes, by scene; empty: as it is
    const std::string gathered = std::to_string(file_.count("nodes"));
    for (const Json& scene : json["scenes"]) {
      std::size_t shown = 0;
      std::string others;
      for (const JsonPlace& place : JsonPlace(scene, document_.file).entries("nodes")) {
        const int node = place.as_index(document_.nodes.size(), "node");
        const bool is_gathered = roots.count(node) > 0;
        shown += is_gathered;
        if (!is_gathered) others += std::to_string(node) + ",";
      }
      if (shown != 0 && shown != of_file) return false;  // roots that a scene leaves out must not appear in it
      lists.push_back(shown == 0 ? "" : "[" + others + gathered + "]");
    }
    file_.add("nodes", text_of({{"name", "roots"}, {"children", roots}}));
    for (std::size_t s = 0; s < lists.size(); ++s) {
      if (!lists[s].empty()) file_.text().set(file_.original("scenes", s), "nodes", lists[s]);
    }
    return true;
  }

  /// The node that an animation moves and that all bound meshes are below, or are; -1 when none is moved. A rig that
  /// the file has had is replaced, with the motion that it had.
  int common_carrier() {
    if (source_.rig.skeleton.size() > 0) {
      if (!document_.animations.empty())
        notes_.add("idle_animations", "animations of the joints that the file had move no mesh any more");
      return -1;
    }
    std::optional<int> common;
    for (const BoundNode& bound : bound_) {
      int carrier = bound.node;
      while (carrier >= 0 && source_.moving[at(carrier)] == 0) carrier = document_.nodes[at(carrier)].parent;
      if (common && *common != carrier) {
        const int moved = std::max(*common, carrier);
        not_supported(moved, "a new skeleton for meshes that animation '" + animation_of(moved) + "' moves apart");
      }
      common = carrier;
    }
    return common.value_or(-1);
  }

  std::string animation_of(int node) const {
    for (const AnimationEntry& animation : document_.animations) {
      for (const AnimationChannel& channel : animation.channels) {
        if (channel.node == node) return animation.name;
      }
    }
    return "";
  }

  /// Rest transform of the skeleton's root relative to a node of the file, or in glTF's world for -1.
  Transform root_below(int node) const {
    Transform root = skeleton_.rest[0];
    const Eigen::Matrix3d y_up = axis_rotation(ExportAxes::kGltf);
    root.translation = y_up * root.translation;
    root.rotation = (Eigen::Quaterniond(y_up) * root.rotation).normalized();
    if (node < 0) return root;
    Matrix4d above = Matrix4d::Identity();
    for (int n = node; n >= 0; n = document_.nodes[at(n)].parent) above = document_.nodes[at(n)].matrix * above;
    double shear = 1.0;
    const Transform local = decompose(above.inverse() * root.matrix(), &shear);
    if (!(shear < 1e-6)) not_supported(node, "a skeleton below a moving node of uneven scale");
    return local;
  }

  /// Appends a new root node to the scenes that show a bound mesh.
  void show(int root) {
    const Json& json = file_.json();
    const std::size_t scenes = json.contains("scenes") ? json["scenes"].size() : 0;
    for (std::size_t s = 0; s < scenes; ++s) {
      std::set<int> shown;
      for (const JsonPlace& node : JsonPlace(json["scenes"][s], document_.file).entries("nodes"))
        shown.insert(node.as_index(document_.nodes.size(), "node"));
      const bool has_bound = std::any_of(bound_.begin(), bound_.end(), [&](const BoundNode& bound) {
        int n = bound.node;
        while (n >= 0 && shown.count(n) == 0) n = document_.nodes[at(n)].parent;
        return n >= 0;
      });
      if (!has_bound) continue;
      const auto list = file_.text().find(file_.original("scenes", s), "nodes");
      if (list) file_.text().append(*list, {std::to_string(root)});
    }
  }

  void add_skins() {
    std::vector<std::string> skins;
    const auto add = [&](bool of_file) {
      for (PlannedSkin& skin : skins_) {
        if (!is_longer(skin) || (skin.old >= 0) != of_file) continue;
        skin.index = static_cast<int>(skins.size());
        skins.push_back(text_of(skin_json(skin)));
      }
    };
    // Blender's importer takes the rest pose of a joint from the last skin that has it. That has to be one of the file:
    // the inverse bind matrices of parts without a skin hold the transforms of their nodes, too.
    add(false);
    const std::size_t before = skins.size();
    std::vector<int> renumbered(document_.skins.size(), -1);
    for (std::size_t s = 0; s < renumbered.size(); ++s) {
      if (!is_own_ && !is_kept(static_cast<int>(s))) continue;
      renumbered[s] = static_cast<int>(skins.size());
      skins.emplace_back(file_.text().text(file_.original("skins", s)));
    }
    for (PlannedSkin& skin : skins_) {
      if (!is_longer(skin)) skin.index = renumbered[at(skin.old)];
    }
    const std::size_t kept = skins.size() - before;
    add(true);
    if (kept == renumbered.size() && (before == 0 || kept == 0)) {
      for (std::size_t s = kept; s < skins.size(); ++s) file_.add("skins", std::move(skins[s]));
      return;
    }
    file_.set_array("skins", skins);
    for (std::size_t n = 0; n < document_.nodes.size(); ++n) {
      const int skin = document_.nodes[n].skin;
      if (skin >= 0 && !is_bound(static_cast<int>(n)) && renumbered[at(skin)] != skin)
        file_.text().set(file_.original("nodes", n), "skin", std::to_string(renumbered[at(skin)]));
    }
  }

  /// True for a skin of a node that stays as it is.
  bool is_kept(int skin) const {
    for (std::size_t n = 0; n < document_.nodes.size(); ++n) {
      if (document_.nodes[n].skin == skin && !is_bound(static_cast<int>(n))) return true;
    }
    return false;
  }

  bool is_bound(int node) const {  // bound_ is in the order of nodes
    const auto found = std::lower_bound(bound_.begin(), bound_.end(), node,
                                        [](const BoundNode& bound, int n) { return bound.node < n; });
    return found != bound_.end() && found->node == node;
  }

  Json skin_json(const PlannedSkin& skin) {
    Json json = Json::object();
    std::vector<double> old_matrices;
    std::size_t old_joints = 0;
    if (skin.old >= 0) {
      const Skin& old = document_.skins[at(skin.old)];
      json = file_.json()["skins"][at(skin.old)];
      json.erase("skeleton");  // need not be above the joints that are added
      old_joints = old.joints.size();
      if (old.inverse_bind_accessor >= 0) old_matrices = read_doubles(document_, old.inverse_bind_accessor, old_joints);
    }
    std::vector<float> matrices;
    Json joints = Json::array();
    for (std::size_t k = 0; k < skin.joints.size(); ++k) {
      const int joint = skin.joints[k];
      joints.push_back(node_of_joint_[at(joint)]);
      Matrix4d inverse = Matrix4d::Identity();
      if (k >= old_joints)
        inverse = skeleton_.bind[at(joint)].inverse() * skin.to_bind;
      else if (!old_matrices.empty())
        inverse = Eigen::Map<const Matrix4d>(old_matrices.data() + 16 * k);
      if (k >= old_joints) inverse.row(3) = Eigen::RowVector4d(0, 0, 0, 1);
      const Eigen::Matrix4f stored = inverse.cast<float>();
      if (!stored.allFinite()) {
        throw InputError(document_.file, "",
                         "inverse bind matrix of joint '" + skeleton_.names[at(joint)] + "' exceeds single precision");
      }
      matrices.insert(matrices.end(), stored.data(), stored.data() + 16);  // column-major, as in glTF
    }
    json["inverseBindMatrices"] = file_.add_accessor(matrices, 16, false);
    if (!is_own_) json["skeleton"] = node_of_joint_[0];
    json["joints"] = std::move(joints);
    return json;
  }

  void bind_node(const BoundNode& bound, GraftReport& report) {
    const JsonText::Span node = file_.original("nodes", at(bound.node));
    const int mesh = document_.nodes[at(bound.node)].mesh, skin = skins_[bound.skin].index;
    std::string text = mesh_text(bound, mesh);
    if (may_change(mesh)) {
      file_.text().replace(file_.original("meshes", at(mesh)), std::move(text));
    } else {
      file_.text().set(node, "mesh", std::to_string(file_.add("meshes", std::move(text))));
      ++report.copied_meshes;
    }
    if (!is_own_ || document_.nodes[at(bound.node)].skin != skin) file_.text().set(node, "skin", std::to_string(skin));
  }

  /// True once for a mesh that only bound nodes show, so that the first of them may keep it.
  bool may_change(int mesh) {
    if (!changed_.insert(mesh).second) return false;
    for (std::size_t n = 0; n < document_.nodes.size(); ++n) {
      if (document_.nodes[n].mesh == mesh && !is_bound(static_cast<int>(n))) return false;
    }
    return true;
  }

  std::string mesh_text(const BoundNode& bound, int mesh) {
    JsonText text(file_.text().text(file_.original("meshes", at(mesh))));
    const std::vector<JsonText::Span> primitives = text.elements(*text.find(text.root(), "primitives"));
    std::map<std::size_t, Json> known;  // by first row: primitives may have their vertices in common
    for (const PrimitiveRows& rows : bound.primitives) {
      const Json& original = file_.json()["meshes"][at(mesh)]["primitives"][at(rows.primitive)];
      const auto [weights, is_new] = known.try_emplace(rows.rows.empty() ? rows.first : ~at(rows.primitive));
      if (is_new) weights->second = weight_attributes(rows, skins_[bound.skin]);
      Json attributes = without_weights(original["attributes"]);
      attributes.update(weights->second);
      const JsonText::Span place = primitives[at(rows.primitive)];
      text.replace(*text.find(place, "attributes"), text_of(attributes));
      const auto compressed = text.find_below(place, {"extensions", "KHR_draco_mesh_compression", "attributes"});
      if (!compressed) continue;
      const Json& draco = original["extensions"]["KHR_draco_mesh_compression"]["attributes"];
      const Json rest = without_weights(draco);
      if (rest.size() != draco.size()) text.replace(*compressed, text_of(rest));
    }
    return text.edited();
  }

  static Json without_weights(const Json& attributes) {
    Json rest = Json::object();
    for (const auto& [name, accessor] : attributes.items()) {
      if (name.rfind("JOINTS_", 0) != 0 && name.rfind("WEIGHTS_", 0) != 0) rest[name] = accessor;
    }
    return rest;
  }

  Json weight_attributes(const PrimitiveRows& rows, const PlannedSkin& skin) {
    SkinWeights entries;
    for (std::size_t i = 0; i < rows.count; ++i) {
      entries.append_copy(skin_, rows.row(i));
      for (std::size_t k = entries.offsets[i]; k < entries.influences.size(); ++k)
        entries.influences[k].joint = skin.entries[at(entries.influences[k].joint)];
    }
    Json attributes = Json::object();
    const std::vector<InfluenceSet> sets = influence_sets(entries, options_.influences);
    for (std::size_t s = 0; s < sets.size(); ++s) {
      const std::vector<std::uint32_t>& joints = sets[s].joints;
      attributes["JOINTS_" + std::to_string(s)] =
          skin.joints.size() <= kMostJointsInBytes
              ? file_.add_accessor(std::vector<std::uint8_t>(joints.begin(), joints.end()), 4, true)
              : file_.add_accessor(std::vector<std::uint16_t>(joints.begin(), joints.end()), 4, true);
      attributes["WEIGHTS_" + std::to_string(s)] = file_.add_accessor(sets[s].weights, 4, true);
    }
    return attributes;
  }

  /// Names come from foreign files and need not be UTF-8, which JSON demands.
  static std::string text_of(const Json& json) { return json.dump(-1, ' ', false, Json::error_handler_t::replace); }

  const GraftSource& source_;
  const Document& document_;
  bool is_own_;
  const Skeleton skeleton_;  // of the file where it is its own, with the joints that are added behind them
  SkinWeights skin_;         // of its joints
  const GraftOptions& options_;
  GraftFile file_;
  Notes notes_;
  std::vector<int> node_of_joint_;                      // in the copy
  std::vector<int> parent_of_added_, below_made_root_;  // nodes of joints added to the file's own
  std::vector<PlannedSkin> skins_;
  std::vector<BoundNode> bound_;  // by node
  std::set<int> changed_;         // meshes that some bound node has asked for
  std::optional<geometry::PointIndex> nearest_;
};

}  // namespace

}  // namespace gltf_import

GraftReport graft_rig(const std::filesystem::path& original, const Skeleton& skeleton, const SkinWeights& skin,
                      const std::filesystem::path& out, const GraftOptions& options) {
  const bool binary = is_binary_extension(out);
  try {
    const gltf_import::GraftSource source(original);
    gltf_import::check_graft(source, skeleton, skin, options);
    std::string why_not;  // nobody asks: another skeleton is added beside the file's
    const std::vector<int> own =
        options.replace ? std::vector<int>()
                        : gltf_import::own_joints(source.rig.skeleton, skeleton, skeleton.names, source.noise, why_not);
    Skeleton named = skeleton;
    if (!options.names.empty()) named.names = options.names;
    GraftReport report;
    write_file_atomically(out, gltf_import::Grafter(source, named, skin, own, options).graft(binary, own, report));
    return report;
  } catch (const std::bad_alloc&) {
    throw InputError(original.string(), "", "copying it needs more memory than there is");
  } catch (const std::length_error&) {
    throw InputError(original.string(), "", "copying it needs more memory than there is");
  }
}

}  // namespace anigen::io
