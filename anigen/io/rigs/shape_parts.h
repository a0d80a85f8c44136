#pragma once
#include <string>
#include <vector>

#include "anigen/io/rigs/array_fields.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "anigen/io/rigs/skin_rows.h"

namespace anigen::io {

/// The first joint without a parent, where vertices without weights go; 0 when there is no joint.
std::int32_t first_root(const JointTree& tree);

/// The collected rows as the shape's skin, with what they tell about it; vertices without weights go to `fallback`.
void set_skin(RiggedShape& shape, SkinRows& rows, std::int32_t fallback);

/// The shape's skin from an array [V, J] of its vertices and joints; repairs become notes (skin_rows.h).
/// @throws InputError when the sizes differ or a weight is not finite
void set_dense_skin(const ArrayFields& fields, const std::string& name, RiggedShape& shape);

/// Normals of any length as unit vectors; those without length or with NaN come from the faces. None is no error; a
/// wrong number of them is left out with a note, since nothing else depends on them.
void set_normals(RiggedShape& shape, std::vector<Eigen::Vector3f> normals);

/// A shape of this id and file with what the arrays `vertices`, `faces` and `normals_name` say; any may be missing.
RiggedShape shape_with_mesh(const ArrayFields& fields, const std::string& normals_name, const std::string& id,
                            const std::string& file);

/// Notes, once everything was read: no mesh, a point set, no skeleton, joints in one place, several roots, no skin.
void note_missing_parts(RiggedShape& shape);

}  // namespace anigen::io
