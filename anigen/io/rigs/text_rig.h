#pragma once
#include <filesystem>
#include <string>

#include "anigen/io/rigs/rigged_shape.h"

namespace anigen::io {

/// The mesh that belongs to a rig: <stem>.obj beside it; else for a stem ending in "_rig" the same without that; else,
/// as RigNet's own data lie, obj…/<stem>.obj beside a folder rig_info… . Empty when there is none.
std::filesystem::path mesh_of_text_rig(const std::filesystem::path& rig);

/// A rig in the text format of RigNet (docs/reference/rignet.md, 1), lines in any order:
///   joints <name> <x> <y> <z>
///   root <name>
///   hier <parent> <child>
///   skin <vertex from 0> <joint> <weight> [<joint> <weight> …]
/// Empty lines and lines that start with '#' are skipped. Vertices keep the OBJ file's numbers, which skin lines count;
/// without a mesh the weights are rows for vertices that somebody else has. RigNet's data are Y up with y from 0.
/// @param axes kZUp for rigs whose writer kept Z up
/// @throws InputError naming the line: an unknown keyword or joint name, a joint or its parent given twice, a wrong
/// number of words, a number that is none or not finite, a vertex weighted twice or not in the mesh; and without a line
/// when there is no joint, not exactly one root line, or a cycle
RiggedShape read_text_rig(const std::filesystem::path& rig, const std::string& id, Axes axes = Axes::kFormat);

/// True when a text file's first word is one of the four keywords: split lists and notes are text files too.
bool is_text_rig(const std::filesystem::path& file);

}  // namespace anigen::io
