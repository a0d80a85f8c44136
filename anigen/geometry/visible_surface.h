#pragma once
#include "anigen/asset/mesh.h"
#include "anigen/geometry/hidden_faces.h"

namespace anigen::geometry {

/// Faces that can be seen from outside: from one of four points of the face (its centre, and one towards each corner)
/// a ray in one of 64 even directions, on either side of the face, leaves the mesh. A pocket whose opening all of them
/// miss counts as hidden; a face that is seen in part counts as seen.
///
/// Parts of a modelled body often overlap and leave faces inside. A surface reconstructed from pictures or voxels has
/// no such faces, so measures of both sides compare better without them.
/// @return [F] marks, 1 for seen
/// @throws InputError on a bad index or a position that is not finite
FaceMarks seen_faces(const Mesh& mesh);

/// The seen faces and the vertices they use, without any other array; the whole surface when no face is seen.
/// @throws InputError as seen_faces()
Mesh visible_surface(const Mesh& mesh);

}  // namespace anigen::geometry
