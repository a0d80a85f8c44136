#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "anigen/core/json.h"
#include "anigen/io/rigs/rigged_shape.h"
#include "anigen/rig/template_skeleton.h"

namespace anigen::rig {

/// Skeletons of a collection of rigs, each measured by its own mesh. Assets that a data set marks as unusable are left
/// out. @param collection whatever io::open_source reads @param splits files of ids; none: all
/// @throws InputError when nothing is left
std::vector<BoxedSkeleton> skeletons_of(const std::filesystem::path& collection,
                                        const std::vector<std::filesystem::path>& splits);

/// A mesh with a template skeleton placed by bounding box, every vertex bound to the joint with the nearest bone.
/// @throws InputError without a surface
Asset rig_by_template(const io::RiggedShape& shape, const BoxedSkeleton& skeleton);

struct RigRequest {
  std::filesystem::path meshes;               ///< a file or a folder of them; rigs in them are ignored
  std::filesystem::path skeletons;            ///< the collection whose middle skeleton is the template
  std::vector<std::filesystem::path> splits;  ///< of the collection
  std::filesystem::path out;                  ///< a file for a file, a folder for a folder: <id>.glb each
};

struct RigReport {
  std::string id;
  std::filesystem::path file;
  std::string failure;  ///< empty: there is a file
  std::size_t joints = 0, vertices = 0;
  double seconds = 0.0;  ///< reading, rigging and writing
};

struct RigReports {
  std::string skeleton;  ///< whose skeleton was the template
  std::vector<RigReport> meshes;
};

/// The baseline that knows nothing of the mesh but its box: the middle skeleton of a collection (medoid()), placed in
/// it. A mesh that cannot be used is reported and does not stop the others.
/// @throws InputError when the template cannot be made or nothing can be read
RigReports rig_meshes(const RigRequest& request);

Json to_json(const RigReports& reports);
std::string to_text(const RigReports& reports);

}  // namespace anigen::rig
