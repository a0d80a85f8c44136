#include "anigen/lint/welded_rig.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "anigen/core/disjoint_sets.h"
#include "anigen/core/numeric.h"

namespace anigen::lint {

namespace {

/// Difference of two rows of weights, summed over joints, below which they are one: rounding, and a slip of a brush.
constexpr double kSameWeights = 0.02;

double row_difference(const SkinWeights& skin, std::size_t a, std::size_t b) {
  const auto weight_in = [&skin](std::size_t row, std::int32_t joint) {
    for (std::size_t i = 0; i < skin.row_size(row); ++i) {
      if (skin.row(row)[i].joint == joint) return static_cast<double>(skin.row(row)[i].weight);
    }
    return 0.0;
  };
  double sum = 0.0, shared = 0.0;
  for (std::size_t i = 0; i < skin.row_size(a); ++i) {
    const double in_a = static_cast<double>(skin.row(a)[i].weight), in_b = weight_in(b, skin.row(a)[i].joint);
    sum += std::abs(in_a - in_b);
    shared += in_b;
  }
  return sum + std::max(0.0, 1.0 - shared);  // what b gives to joints that a lacks
}

}  // namespace

WeldedRig::WeldedRig(const Asset& asset) : asset_(&asset) {
  const Mesh& mesh = asset.mesh;
  box = bounding_box(mesh.vertices);
  size = box.diagonal();
  if (!(size > 0.0)) size = 1.0;

  std::map<std::array<float, 3>, std::vector<std::int32_t>> known;  // places at a position
  std::vector<std::int32_t> place_of_vertex(mesh.vertices.size());
  for (std::size_t v = 0; v < mesh.vertices.size(); ++v) {
    const Eigen::Vector3f& p = mesh.vertices[v];
    // + 0 makes -0 and 0 one key.
    std::vector<std::int32_t>& here = known[{p.x() + 0.0f, p.y() + 0.0f, p.z() + 0.0f}];
    const auto same = std::find_if(here.begin(), here.end(), [&](std::int32_t place) {
      return row_difference(asset.skin, vertex_of_place_[at(place)], v) < kSameWeights;
    });
    if (same != here.end()) {
      place_of_vertex[v] = *same;
      continue;
    }
    const std::size_t place = places.size();
    if (!here.empty()) twins.emplace_back(at(here.front()), place);
    place_of_vertex[v] = static_cast<std::int32_t>(place);
    here.push_back(place_of_vertex[v]);
    places.push_back(p);
    vertex_of_place_.push_back(v);
    first_entry.push_back(entries.size());
    for (std::size_t i = 0; i < asset.skin.row_size(v); ++i) {
      const Influence& influence = asset.skin.row(v)[i];
      entries.push_back({place_of_vertex[v], influence.joint, static_cast<double>(influence.weight)});
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
  for (const auto& [first, second] : twins) pieces.join_lowest(first, second);
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
