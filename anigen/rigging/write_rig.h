#pragma once
#include <string>

#include "anigen/rigging/rig_meshes.h"

namespace anigen::rigging {

/// Adds a remark to the report of a mesh, after a comma.
void add_note(const std::string& note, RigReport& report);

/// The skeleton of an engine's rig. Joints have no axes of their own here; a body that was turned took them along.
Skeleton oriented(const EngineRig& rig, const EngineOptions& options);

/// Gives an asset the axes and clips of its joints from the mesh's file, where its first joints are those of that file,
/// which has clips; else leaves it as it is.
void add_own_clips(const io::RiggedShape& shape, Asset& asset);

/// @throws InputError when a .vrm is asked for that these meshes cannot give: of several, of a skeleton alone, or
/// without the bones of a human
void refuse_unfit_vrm(const RigRequest& request, const io::ShapeSource& source);

/// Writes the rig to report.file: into a copy of the mesh's file where both are glTF, else into a new file.
/// @param shape the asset's mesh as it was read @param asset its joints are made ready for an engine first, as
/// request.engine says @throws InputError when the copy cannot hold it, or as io::write_rigged()
void write_rig(const RigRequest& request, const io::RiggedShape& shape, Asset& asset, RigReport& report);

}  // namespace anigen::rigging
