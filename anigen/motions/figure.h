#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/asset/rigged_asset.h"
#include "anigen/asset/skeleton.h"

namespace anigen::motions {

/// A skeleton in its bind pose with the surface that each joint moves, and the directions of the body. World frame: Z
/// up, the file's unit.
struct Figure {
  /// Joints with mended parents: a foot that only the root carries, as the targets of inverse kinematics are exported,
  /// hangs on the shin whose surface it continues. Otherwise the skeleton's own.
  JointTree tree;
  std::vector<std::string> names;                     ///< [J]
  std::vector<std::vector<int>> children;             ///< [J], in the mended tree
  std::vector<int> order;                             ///< parents_first(tree)
  std::vector<std::vector<Eigen::Vector3d>> surface;  ///< [J] vertices that the joint moves more than others do
  std::vector<double> mass;                           ///< [J] share of the surface's area, by weights
  std::vector<double> mass_below;                     ///< [J] with all joints below it
  std::vector<int> mirror;  ///< [J] joint on the other side; the joint itself on the plane of symmetry; -1: none
  Eigen::Vector3d forward = -Eigen::Vector3d::UnitY();  ///< horizontal, unit length
  Eigen::Vector3d left = Eigen::Vector3d::UnitX();      ///< forward = left × up
  double middle = 0.0;                                  ///< of the plane of symmetry, along `left`
  Box box;                                              ///< of the surface
  double height = 1.0;                                  ///< of the box
  double size = 1.0;                                    ///< longest side of the box

  std::size_t joints() const { return tree.size(); }
  /// Joint of its mended parents' line that lies below a joint, or is it.
  bool is_below(int joint, int above) const;
  /// All joints of the subtree.
  std::vector<int> subtree(int joint) const;
  /// Joints from one to the other through the tree, both included.
  std::vector<int> path(int from, int to) const;
  /// Lowest z of the surface of these joints; +infinity without any.
  double lowest(const std::vector<int>& joints) const;
};

/// True when the name has one of the words in it, whatever the case of its letters.
bool name_says(const std::string& name, const std::vector<std::string>& words);

/// The figure of a skinned mesh. @throws InputError naming the asset when it has no mesh, no skeleton or no weights, or
/// validate() finds something wrong with it
Figure figure_of(const Asset& asset);

/// The figure of a skeleton alone, such as that of motion capture: its bones stand for the surface.
/// @throws InputError as check(), or when all joints are in one place
Figure figure_of(const JointTree& tree, const std::vector<std::string>& names);

}  // namespace anigen::motions
