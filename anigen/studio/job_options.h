#pragma once
#include <string>
#include <vector>

#include "anigen/core/config.h"
#include "anigen/engine/animate.h"
#include "anigen/engine/evaluate.h"
#include "anigen/engine/generator.h"
#include "anigen/engine/rig.h"

namespace anigen::studio {

/// Options of a job, as its JSON has them.
struct JobOptions {
  engine::RigOptions rig;
  engine::GenerateOptions generate;
  engine::AnimateOptions animate;  ///< its motions are those below
  engine::EvaluateOptions evaluate;
  std::string voxels_of;             ///< job whose voxels a generation begins with; empty: it makes its own
  bool all_motions = true;           ///< every built-in motion that the body can do
  std::vector<std::string> motions;  ///< else these
};

/// Reads the options of docs/studio.md.
/// @param kind one of job_kinds() @throws InputError naming the key that is unknown, of another type or out of range
JobOptions parse_job_options(const Json& json, const std::string& kind);

/// Methods that need joints: they take those of the mesh.
bool keeps_joints(const std::string& method);

/// Words of `method`.
const std::vector<std::string>& rig_methods();
/// Words of `names`.
const std::vector<std::string>& name_presets();

enum class UploadFormat { kImage, kMask, kMesh, kRig, kMotion };

/// Refuses a file by its name, which may be one that a browser sends. @throws InputError listing the formats
void require_format(const std::string& name, UploadFormat format);

}  // namespace anigen::studio
