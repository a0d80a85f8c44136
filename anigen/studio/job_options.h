#pragma once
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/engine/animate.h"
#include "anigen/engine/generator.h"
#include "anigen/engine/rig.h"

namespace anigen::studio {

/// Options of a job, as its JSON has them.
struct JobOptions {
  engine::RigOptions rig;            ///< of a mesh
  engine::GenerateOptions generate;  ///< of an image
  bool all_motions = true;           ///< every built-in motion that the body can do
  std::vector<std::string> motions;  ///< else these
};

/// Reads method, skin, templates, keep_skeleton, joints, symmetric, influences and names of a mesh; seed, ss_steps,
/// slat_steps and joints of an image; motions of both.
/// @param kind "image" or "mesh" @throws InputError naming the key that is unknown, of another type or out of range
JobOptions parse_job_options(const Json& json, const std::string& kind);

/// Methods that need joints: they take those of the mesh.
bool keeps_joints(const std::string& method);

/// Words of `method`.
const std::vector<std::string>& rig_methods();

/// "image" or "mesh" by the extension of a file's name, which may be one that a browser sends.
/// @throws InputError listing the formats
std::string kind_of_upload(const std::string& name);

}  // namespace anigen::studio
