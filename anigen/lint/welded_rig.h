#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/geometry/bones.h"
#include "anigen/lint/finding.h"

namespace anigen::lint {

/// A sound rig as the checks of its geometry see it: vertices in one place with the same weights count once, since
/// files split them at texture seams; faces that name a place twice are left out; sums over joints are at hand.
/// P places, F faces, J joints.
class WeldedRig {
 public:
  /// A weight of a place, in the order of places.
  struct Entry {
    std::int32_t place, joint;
    double weight;
  };

  /// @param asset kept by reference @pre validate(asset) finds nothing, except rows without weights
  explicit WeldedRig(const Asset& asset);

  const Asset& asset() const { return *asset_; }
  std::size_t joint_count() const { return joints.size(); }
  const std::string& joint_name(std::size_t joint) const { return asset_->skeleton.names[joint]; }
  /// Distance from a point to the segments that a joint moves, in units of the asset.
  double distance_to_bone(const Eigen::Vector3d& point, std::size_t joint) const;

  Place place_of_joint(std::size_t joint) const;
  /// The place as a vertex of the file. @param joint concerned
  Place place_of_vertex(std::size_t place, std::size_t joint) const;
  /// The face as the file numbers it. @param joint concerned
  Place place_of_face(std::size_t face, std::size_t joint) const;

  Box box;
  double size = 0.0;                    ///< diagonal of the box; > 0
  std::vector<Eigen::Vector3f> places;  ///< [P]
  std::vector<Triangle> faces;          ///< [F], of places
  MeshEdges edges{{}, 0};               ///< of these faces
  /// Places at one position whose weights differ, as where rigid parts of a machine meet.
  std::vector<std::pair<std::size_t, std::size_t>> twins;
  std::vector<std::size_t> shells;         ///< [P] the lowest place of the piece that faces and positions join
  std::size_t shell_count = 0;             ///< with faces
  std::vector<Entry> entries;              ///< weights, by place
  std::vector<std::size_t> first_entry;    ///< [P + 1] into entries
  std::vector<Eigen::Vector3d> joints;     ///< [J], bind pose
  std::vector<std::vector<int>> children;  ///< [J]
  std::vector<double> weights;             ///< [J] sum over places
  std::vector<double> subtree_weights;     ///< [J] of the joint and everything below it
  std::vector<std::size_t> subtree_sizes;  ///< [J] joints, itself among them

 private:
  const Asset* asset_;
  std::vector<std::size_t> vertex_of_place_, face_of_file_;
  std::vector<std::vector<geometry::BoneSegment>> bones_;
};

}  // namespace anigen::lint
