#pragma once
#include <string>
#include <vector>

#include "anigen/rigging/rig_meshes.h"

namespace anigen::rigging {

/// Note of joints that the mesh's file has had, until a step replaces them.
inline constexpr char kKeepsJoints[] = "keeps its own joints";

/// Adds a remark to the report of a mesh, after a comma.
void add_note(const std::string& note, RigReport& report);

/// The skeleton of an engine's rig. Joints have no axes of their own here; a body that was turned took them along.
Skeleton oriented(const EngineRig& rig, const EngineOptions& options);

/// Names that the joints of an engine's rig had before, [J]; none where it has made new joints.
/// @param given the skeleton before it
std::vector<std::string> names_before(const EngineRig& rig, const Skeleton& given);

/// Gives an asset the axes and clips of its joints from the mesh's file, where these are the joints of that file, or
/// hold them, and the file has clips: the joints then stand in the file's order, further ones behind, and keep the
/// names that they have in the asset. Else the asset stays as it is, and the report says what was left out, and why.
/// @param names [J] by which the file's joints are known; none: all joints are new
void add_own_clips(const io::RiggedShape& shape, const std::vector<std::string>& names, Asset& asset,
                   RigReport& report);

/// @throws InputError when a .vrm is asked for that these meshes cannot give: of several, of a skeleton alone, or
/// without the bones of a human
void refuse_unfit_vrm(const RigRequest& request, const io::ShapeSource& source);

/// Writes the rig to report.file: into a copy of the mesh's file where both are glTF, else into a new file.
/// @param shape the asset's mesh as it was read @param asset its joints are made ready for an engine first, as
/// request.engine says @throws InputError when the copy cannot hold it, or as io::write_rigged()
void write_rig(const RigRequest& request, const io::RiggedShape& shape, Asset& asset, RigReport& report);

}  // namespace anigen::rigging
