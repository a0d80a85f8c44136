#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "anigen/asset/mesh.h"

namespace anigen::mesh_health {

/// A mesh whose vertices at one position are one place, since files split them at texture seams and creases. Faces that
/// name a place twice, and repetitions of a face whichever way round, are left out.
struct WeldedMesh {
  std::vector<Eigen::Vector3f> places;    ///< [P] in the order of their first vertices
  std::vector<std::int32_t> of_vertex;    ///< [V] the place of each vertex
  std::vector<Triangle> faces;            ///< [F] of places
  std::vector<std::size_t> face_of_file;  ///< [F] as the mesh numbers them
  std::size_t collapsed_faces = 0;        ///< left out: they name a place twice
  std::size_t duplicate_faces = 0;        ///< left out: an earlier face has these three places
  std::size_t isolated_vertices = 0;      ///< vertices of no face
};

/// @param distance places this near each other are one, too, in chains of any length; the first vertex keeps its
/// position. 0: equal positions alone
/// @throws InputError for a mesh without faces, naming a vertex that is not finite or a face that refers to a missing
/// one, or when the distance is negative or not finite
WeldedMesh weld(const Mesh& mesh, double distance = 0.0);

/// A face whose corners stand on one line, up to the rounding of a product of doubles.
bool is_degenerate(const std::vector<Eigen::Vector3f>& vertices, const Triangle& face);

/// Moves vertices at the position of earlier ones into their own part, towards the middle of their faces, by a
/// millionth of the box's diagonal, the third of one position by two: formats without indices, and programs that weld,
/// would make them one again.
void move_apart(Mesh& mesh);

/// A position as a key of a hash table; 0 and -0 are equal.
struct PositionHash {
  std::size_t operator()(const Eigen::Vector3f& position) const;
};

}  // namespace anigen::mesh_health
