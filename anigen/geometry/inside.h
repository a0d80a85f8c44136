#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::geometry {

/// Inside or outside of a mesh, by generalised winding numbers (Jacobson et al. 2013): the solid angle under which
/// the faces are seen, signed by their side, over 4π. That is a whole number for a closed surface and changes smoothly
/// near the holes of an open one. A point is inside when the absolute value is at least ½ for the whole mesh or for one
/// of its connected parts, so overlapping parts do not matter, nor parts whose faces point inwards. A sheet surrounds
/// nothing. Costs points × faces: for some hundred points, such as joints.
class InsideTest {
 public:
  /// Vertices at one position are one. Faces with a bad index or a corner that is not finite do not count.
  explicit InsideTest(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces);

  /// One entry per point; runs on all threads. @param margin points this near to the surface are inside
  /// @return false for a point that is not finite, and without faces
  std::vector<bool> inside(const std::vector<Eigen::Vector3d>& points, double margin = 0.0) const;

  /// Sum over all faces. @param point not on the surface
  double winding_number(const Eigen::Vector3d& point) const;

 private:
  struct Corners {
    Eigen::Vector3d a, b, c;
  };
  struct Part {
    std::size_t begin, end;  ///< into corners_
  };
  double winding_number(const Eigen::Vector3d& point, const Part& part) const;
  bool contains(const Eigen::Vector3d& point, double margin) const;

  std::vector<Corners> corners_;  ///< part by part
  std::vector<Part> parts_;
  Box box_;
};

}  // namespace anigen::geometry
