#pragma once
#include <Eigen/Core>

#include "anigen/asset/skeleton.h"
#include "anigen/io/gltf/gltf.h"

namespace anigen::io {

/// The proper rotation from the project's world (Z up) to the file's (Y up). Its entries are exactly -1, 0 or 1,
/// so positions and normals turn without rounding.
Eigen::Matrix3d axis_rotation(ExportAxes axes);

/// A skeleton whose joints have these positions and, in a file with these axes, no rotation: bind pose and rest pose
/// are translations alone, as the published exporter writes them (docs/reference/flows.md, 5.9). For skeletons without
/// orientations of their own, such as generated ones. Rest pose = bind pose.
Skeleton unrotated_in_file(const Skeleton& skeleton, ExportAxes axes);

}  // namespace anigen::io
