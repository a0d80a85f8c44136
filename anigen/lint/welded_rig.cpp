#include "anigen/lint/welded_rig.h"

#include <array>
#include <limits>
#include <map>
#include <set>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/numeric.h"

namespace anigen::lint {

WeldedRig::WeldedRig(const Asset& asset) : asset_(&asset) {
  const Mesh& mesh = asset.mesh;
  box = bounding_box(mesh.vertices);
  size = box.diagonal();
  if (!(size > 0.0)) size = 1.0;

  std::map<std::array<float, 3>, std::int32_t> known;
  std::vector<std::int32_t> place_of_vertex(mesh.vertices.size());
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const Eigen::Vector3f& p = mesh.vertices[v];
    // + 0 makes -0 and 0 one key.
    const auto [entry, is_new] =
        known.try_emplace({p.x() + 0.0f, p.y() + 0.0f, p.z() + 0.0f}, static_cast<std::int32_t>(places.size()));
    place_of_vertex[v] = entry->second;
    if (!is_new) continue;
    places.push_back(p);
    vertex_of_place_.push_back(v);
    first_entry.push_back(entries.size());
    for (std::size_t i = 0; i < asset.skin.row_size(v); ++i) {
      const Influence& influence = asset.skin.row(v)[i];
      entries.push_back({entry->second, influence.joint, static_cast<double>(influence.weight)});
    }
  }
  first_entry.push_back(entries.size());

  DisjointSets pieces(places.size());
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    Triangle face = mesh.faces[f];
    for (std::int32_t& corner : face) corner = place_of_vertex[at(corner)];
    if (face[0] == face[1] || face[1] == face[2] || face[2] == face[0]) continue;
    pieces.join_lowest(at(face[0]), at(face[1]));
    pieces.join_lowest(at(face[0]), at(face[2]));
    faces.push_back(face);
    face_of_file_.push_back(f);
  }
  edges = MeshEdges(faces, places.size());
  std::set<std::size_t> with_faces;
  for (std::size_t p = 0; p < places.size(); ++p) shells.push_back(pieces.find(p));
  for (const Triangle& face : faces) with_faces.insert(shells[at(face[0])]);
  shell_count = with_faces.size();

  const Skeleton& skeleton = asset.skeleton;
  joints = skeleton.positions();
  children.resize(joints.size());
  weights.assign(joints.size(), 0.0);
  subtree_sizes.assign(joints.size(), 1);
  std::vector<Eigen::Vector3f> positions;
  for (const Eigen::Vector3d& joint : joints) positions.push_back(joint.cast<float>());
  bones_ = geometry::bone_segments(positions, skeleton.parents);
  for (const Entry& entry : entries) weights[at(entry.joint)] += entry.weight;
  subtree_weights = weights;
  for (std::size_t j = joints.size(); j-- > 1;) {
    const std::size_t parent = at(skeleton.parents[j]);
    children[parent].push_back(static_cast<int>(j));
    subtree_weights[parent] += subtree_weights[j];
    subtree_sizes[parent] += subtree_sizes[j];
  }
}

double WeldedRig::distance_to_bone(const Eigen::Vector3d& point, std::size_t joint) const {
  double nearest = std::numeric_limits<double>::infinity();
  for (const geometry::BoneSegment& bone : bones_[joint]) {
    nearest =
        std::min(nearest, geometry::distance_to_segment(point, bone.start.cast<double>(), bone.end.cast<double>()));
  }
  return nearest;
}

Place WeldedRig::place_of_joint(std::size_t joint) const { return {"joint", joint, joint_name(joint), joints[joint]}; }

Place WeldedRig::place_of_vertex(std::size_t place, std::size_t joint) const {
  return {"vertex", vertex_of_place_[place], joint_name(joint), places[place].cast<double>()};
}

Place WeldedRig::place_of_face(std::size_t face, std::size_t joint) const {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const std::int32_t corner : faces[face]) middle += places[at(corner)].cast<double>() / 3.0;
  return {"face", face_of_file_[face], joint_name(joint), middle};
}

}  // namespace anigen::lint
