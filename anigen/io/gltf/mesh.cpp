#include "anigen/io/gltf/mesh.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>

#include "anigen/core/error.h"
#include "anigen/core/numeric.h"
#include "anigen/io/gltf/primitive.h"

namespace anigen::io::gltf_import {

namespace {

using Eigen::Matrix4d;

// Placement of a vertex block: positions by `matrix`, normals by its inverse transpose.
class Placement {
 public:
  explicit Placement(const Eigen::Matrix4d& matrix) : matrix_(matrix) {
    const Eigen::Matrix3d m = matrix.topLeftCorner<3, 3>();
    is_mirroring_ = m.determinant() < 0.0;
    // Cofactors: the inverse transpose up to a factor, which also exist for collapsed meshes.
    normal_matrix_.col(0) = m.col(1).cross(m.col(2));
    normal_matrix_.col(1) = m.col(2).cross(m.col(0));
    normal_matrix_.col(2) = m.col(0).cross(m.col(1));
    if (is_mirroring_) normal_matrix_ = Eigen::Matrix3d(-normal_matrix_);
  }
  Eigen::Vector3f position(const VertexBlock& block, std::size_t vertex) const {
    const Eigen::Vector3f p = Eigen::Map<const Eigen::Vector3f>(block.positions.data() + 3 * vertex);
    return (matrix_.topLeftCorner<3, 3>() * p.cast<double>() + matrix_.topRightCorner<3, 1>()).cast<float>();
  }
  // Unit length; zero when the file has no usable normal for the vertex.
  Eigen::Vector3f normal(const VertexBlock& block, std::size_t vertex) const {
    if (block.normals.empty()) return Eigen::Vector3f::Zero();
    const Eigen::Vector3f n = Eigen::Map<const Eigen::Vector3f>(block.normals.data() + 3 * vertex);
    const Eigen::Vector3d turned = normal_matrix_ * n.cast<double>();
    const double length = turned.norm();
    if (!(length > 1e-150) || !std::isfinite(length)) return Eigen::Vector3f::Zero();
    return (turned / length).cast<float>().normalized();
  }
  // A mirroring turns triangles inside out.
  bool is_mirroring() const { return is_mirroring_; }

 private:
  Eigen::Matrix4d matrix_;
  Eigen::Matrix3d normal_matrix_;
  bool is_mirroring_;
};

// The arrays of the merged mesh while primitives are appended to it.
class MeshArrays {
 public:
  explicit MeshArrays(const std::string& file) : file_(file) {}

  std::size_t vertices() const { return mesh_.vertices.size(); }
  std::size_t faces() const { return mesh_.faces.size(); }
  Eigen::Vector3f vertex(std::size_t v) const { return mesh_.vertices[v]; }
  // @throws InputError when the vertex leaves the range of float
  void add_vertex(const VertexBlock& block, std::size_t vertex, const Placement& placement) {
    any_normals_ = any_normals_ || !block.normals.empty();
    any_uvs_ = any_uvs_ || !block.uvs.empty();
    any_colors_ = any_colors_ || !block.colors.empty();
    mesh_.vertices.push_back(placement.position(block, vertex));
    if (!mesh_.vertices.back().allFinite())
      throw InputError(file_, "/meshes", "a vertex leaves the range of float in the bind pose");
    mesh_.normals.push_back(placement.normal(block, vertex));
    Eigen::Vector2f uv = Eigen::Vector2f::Zero();
    if (!block.uvs.empty()) uv = Eigen::Map<const Eigen::Vector2f>(block.uvs.data() + 2 * vertex);
    mesh_.uvs.push_back(uv);
    Eigen::Vector4f color = Eigen::Vector4f::Ones();
    if (!block.colors.empty()) color = Eigen::Map<const Eigen::Vector4f>(block.colors.data() + 4 * vertex);
    mesh_.colors.push_back(color);
  }
  // Faces of a block whose first vertex got the number `first_vertex`.
  void add_faces(const std::vector<Triangle>& faces, std::size_t first_vertex, bool turn_around, int material) {
    const auto base = static_cast<std::int32_t>(first_vertex);
    for (const Triangle& face : faces) {
      Triangle moved = {face[0] + base, face[1] + base, face[2] + base};
      if (turn_around) std::swap(moved[1], moved[2]);
      mesh_.faces.push_back(moved);
      mesh_.face_materials.push_back(material);
    }
  }

  // Attributes that only some primitives had are filled up for the others: uv 0, white, the normal of the faces.
  // @throws InputError when there are no faces
  Mesh finish(Notes& notes) {
    if (mesh_.faces.empty()) throw InputError(file_, "/meshes", "the scene has no triangles");
    if (!any_normals_) mesh_.normals.clear();
    if (!any_uvs_) mesh_.uvs.clear();
    if (!any_colors_) mesh_.colors.clear();
    const bool has_materials =
        std::any_of(mesh_.face_materials.begin(), mesh_.face_materials.end(), [](int m) { return m >= 0; });
    if (!has_materials) mesh_.face_materials.clear();
    const auto missing = static_cast<std::size_t>(std::count_if(
        mesh_.normals.begin(), mesh_.normals.end(), [](const Eigen::Vector3f& n) { return n.isZero(0.0f); }));
    if (missing > 0) {
      const std::vector<Eigen::Vector3f> computed = vertex_normals(mesh_.vertices, mesh_.faces);
      for (std::size_t v = 0; v < computed.size(); ++v) {
        if (mesh_.normals[v].isZero(0.0f)) mesh_.normals[v] = computed[v];
      }
      notes.tally("computed_normals", "vertices without a usable normal got the one of their faces", missing);
    }
    return std::move(mesh_);
  }

 private:
  const std::string& file_;
  Mesh mesh_;
  bool any_normals_ = false, any_uvs_ = false, any_colors_ = false;
};

class MeshMerger {
 public:
  MeshMerger(const Document& document, const Rig& rig, const std::vector<SkinBinding>& bindings,
             const ImportOptions& options, Notes& notes)
      : document_(document),
        rig_(rig),
        bindings_(bindings),
        require_rig_(options.require_rig),
        notes_(notes),
        vertices_left_(std::min<std::size_t>(options.max_vertices, 0x7FFFFFFF)),
        faces_left_(options.max_faces),
        joint_positions_(rig.skeleton.positions()),
        rest_(forward_kinematics(rig.skeleton.parents, rig.skeleton.rest)),
        arrays_(document.file),
        counted_(document.nodes.size(), 0) {}

  void add_mesh(int mesh, const std::vector<int>& nodes) {
    const MeshEntry& entry = document_.meshes[at(mesh)];
    std::vector<Group> groups;
    std::map<std::pair<std::vector<std::pair<std::string, int>>, std::pair<int, int>>, std::size_t> known;
    for (const Primitive& primitive : entry.primitives) {
      if (primitive.mode < 4) {
        notes_.tally("skipped_lines", "primitives of points or lines were skipped", nodes.size());
        skipped_ = true;
        continue;
      }
      TextureUse texture;
      if (primitive.material >= 0) texture = document_.materials[at(primitive.material)].base_color;
      // Texture transforms are per material, so they keep vertices apart; so does Draco, which brings its own indices.
      const int material = texture.is_transformed ? primitive.material : -1 - texture.set;
      auto attributes = primitive.attributes;
      std::sort(attributes.begin(), attributes.end());
      const auto [place, is_new] = known.try_emplace({attributes, {primitive.draco_view, material}}, groups.size());
      if (is_new || primitive.draco_view >= 0) {
        place->second = groups.size();
        groups.push_back({{}, texture});
      }
      groups[place->second].primitives.push_back(&primitive);
    }
    for (const Group& group : groups) add_group(group, mesh, nodes);
  }

  MergedMesh finish() {
    if (!require_rig_ && arrays_.faces() == 0) {
      if (has_rig()) return {};  // a skeleton without a mesh
      throw InputError(document_.file, "",
                       std::string(skipped_ ? "the scene shows nothing but points and lines, no triangles"
                                            : "the scene has no triangles") +
                           ", no skin and no animation: nothing to read");
    }
    MergedMesh result{arrays_.finish(notes_), std::move(skin_), std::move(ranges_)};
    // Float noise of inverse bind matrices is no disagreement.
    if (conflict_ > 1e-5 * bounding_box(result.mesh.vertices).diagonal()) {
      notes_.add("bind_pose_conflict",
                 "skins disagree about the bind pose of joints they share; their vertices were posed into one of them");
    }
    return result;
  }

 private:
  // Primitives that share their vertices are merged without repeating them.
  struct Group {
    std::vector<const Primitive*> primitives;
    TextureUse texture;
  };

  void add_group(const Group& group, int mesh, const std::vector<int>& nodes) {
    const Primitive& first = *group.primitives.front();
    PrimitiveData data = read_primitive(document_, first, group.texture, vertices_left_ / nodes.size(),
                                        faces_left_ / nodes.size(), notes_);
    vertices_left_ -= std::min(vertices_left_, data.vertices.count * nodes.size());
    if (data.vertices.count == 0 || (data.indices.empty() && group.primitives.size() == 1)) {
      notes_.tally("empty_primitive", "primitives without vertices or triangles were skipped");
      return;
    }
    instances_.clear();
    for (const int node : nodes) {
      VertexRange range;
      range.node = node;
      range.mesh = mesh;
      range.first = arrays_.vertices();
      range.count = data.vertices.count;
      range.is_skinned = is_skinned(data.vertices, node);
      range.to_bind = to_bind(data.vertices, node);
      instances_.push_back({range.first, Placement(range.to_bind).is_mirroring()});
      range.deviation = add_vertices(data.vertices, first, node);
      for (const Primitive* primitive : group.primitives) {
        range.primitive = static_cast<int>(primitive - document_.meshes[at(mesh)].primitives.data());
        ranges_.push_back(range);
      }
    }
    for (const Primitive* primitive : group.primitives) {
      if (primitive != &first)
        data.indices = read_indices(document_, *primitive, data.vertices.count, faces_left_ / nodes.size());
      faces_left_ -= std::min(faces_left_, data.indices.size() / (primitive->mode == 4 ? 3 : 1) * nodes.size());
      add_faces(*primitive, data.indices);
    }
  }

  // @return the largest distance between a vertex by formula and by the matrix of its skin
  double add_vertices(const VertexBlock& block, const Primitive& primitive, int node) {
    if (is_skinned(block, node)) return add_skinned(block, primitive, bindings_[at(document_.nodes[at(node)].skin)]);
    add_rigid(block, node);
    return 0.0;
  }

  Matrix4d rigid_to_bind(int node) const {
    const Matrix4d& below = rig_.below_joint[at(node)];
    const int joint = rig_.nearest_joint[at(node)];
    if (joint >= 0) return rig_.skeleton.bind[at(joint)] * below;
    if (!has_rig()) {  // nothing is rounded: (X, Y, Z) → (X, −Z, Y)
      Matrix4d turned = below;
      turned.row(1) = Eigen::RowVector4d::Zero() - below.row(2);  // no −0
      turned.row(2) = below.row(1);
      return turned;
    }
    // Carried along by the root from where both rest.
    const Matrix4d world = y_up_to_z_up().matrix() * below;
    const Matrix4d to_bind = rig_.skeleton.bind[0] * rest_[0].inverse();
    return to_bind.allFinite() ? Matrix4d(to_bind * world) : world;
  }

  Matrix4d to_bind(const VertexBlock& block, int node) const {
    return is_skinned(block, node) ? bindings_[at(document_.nodes[at(node)].skin)].to_bind : rigid_to_bind(node);
  }

  void add_rigid(const VertexBlock& block, int node) {
    const Placement placement(rigid_to_bind(node));
    if (!has_rig()) {
      for (std::size_t v = 0; v < block.count; ++v) arrays_.add_vertex(block, v, placement);
      return;
    }
    const int joint = rig_.nearest_joint[at(node)];
    const std::size_t meshes = counted_[at(node)] != 0 ? 0 : 1;  // not once per primitive
    counted_[at(node)] = 1;
    if (joint >= 0)
      notes_.tally("rigid_mesh_on_joint", "meshes without skin follow the joint above them", meshes);
    else
      notes_.tally("unskinned_mesh", "meshes without skin and without a joint above them follow the root joint",
                   meshes);
    for (std::size_t v = 0; v < block.count; ++v) {
      arrays_.add_vertex(block, v, placement);
      skin_.append_row({{std::max(joint, 0), 1.0f}});
    }
  }

  double add_skinned(const VertexBlock& block, const Primitive& primitive, const SkinBinding& binding) {
    const std::size_t first = skin_.rows();
    append_weights(block, binding, joint_positions_, document_.file, primitive.pointer, skin_, notes_);
    const Placement placement(binding.to_bind);
    if (binding.deviation.empty()) {
      for (std::size_t v = 0; v < block.count; ++v) arrays_.add_vertex(block, v, placement);
      return 0.0;
    }
    double largest = 0.0;
    std::map<int, std::size_t> entry_of_joint;
    for (std::size_t k = 0; k < binding.joints.size(); ++k) entry_of_joint[binding.joints[k]] = k;
    for (std::size_t v = 0; v < block.count; ++v) {
      Matrix4d deviation = Matrix4d::Zero();
      for (std::size_t i = 0; i < skin_.row_size(first + v); ++i) {
        const Influence& influence = skin_.row(first + v)[i];
        deviation += static_cast<double>(influence.weight) * binding.deviation[entry_of_joint.at(influence.joint)];
      }
      arrays_.add_vertex(block, v, Placement(binding.to_bind + deviation));
      const Eigen::Vector3f moved = arrays_.vertex(arrays_.vertices() - 1) - placement.position(block, v);
      largest = std::max(largest, static_cast<double>(moved.norm()));
    }
    conflict_ = std::max(conflict_, largest);
    return largest;
  }

  void add_faces(const Primitive& primitive, const std::vector<std::uint32_t>& indices) {
    // Draco always stores a plain triangle list.
    const TriangleList triangles = triangulate(primitive.draco_view >= 0 ? 4 : primitive.mode, indices);
    const std::size_t count = instances_.size();
    notes_.tally("degenerate_faces", "faces named a vertex twice and were left out", triangles.degenerate * count);
    notes_.tally("incomplete_triangles", "indices at the end of primitives made no triangle",
                 triangles.left_over * count);
    for (const Instance& instance : instances_)
      arrays_.add_faces(triangles.faces, instance.first_vertex, instance.is_mirrored, primitive.material);
  }

  bool has_rig() const { return rig_.skeleton.size() > 0; }
  bool is_skinned(const VertexBlock& block, int node) const {
    return document_.nodes[at(node)].skin >= 0 && !block.influences.empty();
  }

  const Document& document_;
  const Rig& rig_;
  const std::vector<SkinBinding>& bindings_;
  bool require_rig_;
  Notes& notes_;
  // Counts what was read, not what was kept: primitives that leave nothing behind cost time, too.
  std::size_t vertices_left_, faces_left_;
  std::vector<Eigen::Vector3d> joint_positions_;
  std::vector<Matrix4d> rest_;
  MeshArrays arrays_;
  SkinWeights skin_;
  std::vector<VertexRange> ranges_;
  // Start of the current group, once per node that shows it.
  struct Instance {
    std::size_t first_vertex;
    bool is_mirrored;
  };
  std::vector<Instance> instances_;
  std::vector<char> counted_;  // per node: its mesh without skin was noted
  bool skipped_ = false;       // points or lines
  double conflict_ = 0.0;      // largest of what add_vertices() returned
};

}  // namespace

MergedMesh merge_meshes(const Document& document, const Rig& rig, const std::vector<SkinBinding>& bindings,
                        const ImportOptions& options, Notes& notes) {
  std::vector<std::vector<int>> instances(document.meshes.size());
  for (std::size_t n = 0; n < document.nodes.size(); ++n) {
    const int mesh = document.nodes[n].mesh;
    if (mesh >= 0 && document.in_scene[n] != 0) instances[at(mesh)].push_back(static_cast<int>(n));
  }
  MeshMerger merger(document, rig, bindings, options, notes);
  for (std::size_t m = 0; m < instances.size(); ++m) {
    if (!instances[m].empty()) merger.add_mesh(static_cast<int>(m), instances[m]);
  }
  return merger.finish();
}

}  // namespace anigen::io::gltf_import
