#pragma once
#include <cstddef>
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"

namespace anigen::test {

/// Differences of an asset that was written and read again. Joints are matched by name, corners of faces
/// in the order of materials and faces; lengths are in parts of the mesh's (without a mesh the joints') diagonal.
struct RigDifference {
  std::vector<std::string> broken;  ///< counts, names, parents and clips that differ: then numbers below may be missing
  double vertices = 0.0;            ///< largest distance of a corner
  double normals = 0.0, uvs = 0.0, colors = 0.0;  ///< largest difference of a number
  double weights = 0.0;                           ///< largest difference of a weight
  double bind_positions = 0.0;                    ///< largest distance of a joint in the bind pose
  double clip_seconds = 0.0;                      ///< largest difference of a clip's length
  double moving_joints = 0.0;                     ///< largest distance of a joint at any of the sampled times
};

/// @param influences joints per vertex that the writer kept @param samples times in each clip, ends included
RigDifference rig_difference(const Asset& before, const Asset& after, std::size_t influences = 4,
                             std::size_t samples = 23);

/// Vertices that a reader finds which knows corners only: those of faces, each once per material and equal content.
std::size_t distinct_vertices(const Asset& asset);

}  // namespace anigen::test
