#pragma once
#include <Eigen/Core>
#include <vector>

#include "anigen/asset/mesh.h"
#include "anigen/geometry/face_sets.h"

namespace anigen::geometry {

/// Constants of reference flows-and-pipeline.md, 5.8.
struct HiddenFaceRules {
  double largest_hole = 0.04;  ///< area, mesh unit squared: a part whose removal opens a larger hole stays
  double visible_part = 0.25;  ///< a part stays when half of its faces are seen in more than this share of views
  double least_outer = 0.25;   ///< bounds of the visibility above which a face counts as outside:
  double most_outer = 0.5;     ///<   the 75th percentile of its component, within these
};

/// Which faces are inside a closed or nearly closed surface (reference flows-and-pipeline.md, 5.8). Faces that no view
/// sees are inside, faces that are seen more often than most of their component outside; between them the surface is
/// cut where the cut is shortest, and of the pieces inside those are hidden that are rarely seen and leave no large
/// hole. Medians are the lower one of two.
/// @param visibility [F] share of views around the mesh in which a face is seen, as raytrace::face_visibility gives it
/// @return [F] marks; none when every face is seen
/// @throws InputError when lengths differ or a face refers to a missing vertex
FaceMarks hidden_faces(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                       const std::vector<float>& visibility, const HiddenFaceRules& rules = {});

}  // namespace anigen::geometry
