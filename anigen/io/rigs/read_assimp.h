#pragma once
#include <filesystem>

#include "anigen/io/gltf/gltf.h"

namespace anigen::io {

/// Reads a skinned FBX (binary or text) or COLLADA file through Assimp, with the same stages, repairs and notes as
/// read_gltf(): all skins in one skeleton, all meshes in one mesh in a common bind pose, Z up. What the file says about
/// its up axis and unit is applied (metres). FBX pivots are folded into their joint, animations then re-sampled at
/// their keys. Materials keep base colour, and the texture when it is embedded or lies in or below the file's folder.
///
/// Before Assimp sees a file it is scanned for what its recursion cannot stand: nesting, scene graphs with cycles or
/// that grow without bound. Assimp works in a process of its own (run_guarded), since files exist that end it or that
/// it never finishes; that process has no right to write files, run programs or open sockets (core/sandbox.h).
/// @throws InputError naming the file, also when Assimp crashed on it or took too long; NotSupportedError for other
/// extensions, and for all in a lean build
ImportedAsset read_assimp(const std::filesystem::path& file, const ImportOptions& options = {});

}  // namespace anigen::io
