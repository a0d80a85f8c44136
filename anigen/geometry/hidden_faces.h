#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::geometry {

/// Parts of meshes: faces chosen by a mark per face, 0 for no.
using FaceMarks = std::vector<char>;

/// The faces that name three different vertices, in order.
std::vector<Triangle> proper_faces(const std::vector<Triangle>& faces);

/// Faces that hang together by edges, as lists of faces, each ascending; in the order of their first faces.
/// @param chosen [F], or empty for all faces
std::vector<std::vector<std::int32_t>> face_components(const MeshEdges& edges, std::size_t faces,
                                                       const FaceMarks& chosen = {});

/// The chosen faces and the vertices they use, both in their old order; nothing else of a mesh.
/// @pre faces refer to vertices that exist, one mark per face
Mesh chosen_faces(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                  const FaceMarks& chosen);

/// An edge of an undirected graph: cutting it costs its capacity.
struct CutEdge {
  std::int32_t a, b;
  double capacity;  ///< ≥ 0
};

/// The cheapest cut between a source and a sink that are joined to some of the nodes by edges of capacity 1 (maximum
/// flow by push-relabel, Goldberg and Tarjan 1988). Capacities count to 1e-9; one that exceeds the number of nodes can
/// never be worth cutting and is taken for that number.
/// @return [nodes] 1 on the source's side. Of several cheapest cuts the one with the most nodes there: all that the
/// sink cannot be reached from. @throws InputError when an edge, a source or a sink is no node, or a capacity negative
/// or NaN
std::vector<char> source_side_of_min_cut(std::size_t nodes, const std::vector<CutEdge>& edges,
                                         const std::vector<std::int32_t>& sources,
                                         const std::vector<std::int32_t>& sinks);

/// Constants of docs/reference/flows.md, 5.6.
struct HiddenFaceRules {
  double largest_hole = 0.04;  ///< area, mesh unit squared: a part whose removal opens a larger hole stays
  double visible_part = 0.25;  ///< a part stays when half of its faces are seen in more than this share of views
  double least_outer = 0.25;   ///< bounds of the visibility above which a face counts as outside:
  double most_outer = 0.5;     ///<   the 75th percentile of its component, within these
};

/// Faces inside a closed or nearly closed surface (docs/reference/flows.md, 5.6). Faces that no view sees are inside,
/// faces that are seen more often than most of their component outside; between them the surface is cut where the cut
/// is shortest, and of the pieces inside those are hidden that are rarely seen and leave no large hole. Medians are the
/// lower one of two.
/// @param visibility [F] share of views around the mesh in which a face is seen, as render::face_visibility gives it
/// @return [F] marks; none when every face is seen
/// @throws InputError when lengths differ or a face refers to a missing vertex
FaceMarks hidden_faces(const std::vector<Eigen::Vector3f>& vertices, const std::vector<Triangle>& faces,
                       const std::vector<float>& visibility, const HiddenFaceRules& rules = {});

}  // namespace anigen::geometry
