#pragma once
#include "anigen/engine/rig.h"
#include "anigen/rigging/rig_meshes.h"

namespace anigen::engine {

/// Request of a rig by the options, those of this library and of anigen-rig.
/// @param further what the library has no option for: files, a given skeleton, voxels, models, whether the file is of
/// a humanoid
/// @throws InputError for an unknown word, which names the program's option
rigging::RigRequest rig_request(const RigOptions& options, rigging::RigRequest further = {});

}  // namespace anigen::engine
