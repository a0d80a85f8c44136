#pragma once
#include <filesystem>
#include <string>
#include <utility>

#include "anigen/core/config.h"
#include "anigen/io/gltf/gltf.h"

namespace anigen::eval {

/// Kind of a file or folder.
enum class FileKind {
  kScene,    ///< .glb .gltf .fbx .dae: a rigged asset, a mesh without a rig, or a skeleton with its motion
  kMesh,     ///< .obj .ply .stl
  kTextRig,  ///< .txt with a rig of RigNet, and its .obj
  kRigNpz,   ///< .npz with plain arrays of a rig
  kSample,   ///< FILE#ID of a shard, or of a data set
  kMotion,   ///< .bvh
  kShard,    ///< .npz of Articulation-XL, .pt or .pth of Anymate: many rigs
  kPicture,
  kArrays,
  kConfig,
  kDataset,
  kRun,
  kFolder  ///< another folder with files of these kinds
};

/// By extension, and by content where that says too little (.npz .pt .pth .txt, folders: metadata.csv is a data set's,
/// config.json or ckpts a run's). @throws InputError for anything else
FileKind file_kind(const std::filesystem::path& path);

/// Meshes, skeletons and what binds them: what read_geometry() reads.
bool is_geometry(FileKind kind);

/// A file's mesh and skeleton, through the readers that rigging and evaluation use. Parts may be missing.
struct Geometry {
  io::ImportedAsset imported;  ///< Z up
  Json source;                 ///< `format`, `axes`, `unit`, and what only this format has
};

/// @throws InputError with file and place
Geometry read_geometry(const std::filesystem::path& path, FileKind kind);

/// Counts, names and ranges of an asset.
Json describe_asset(const io::ImportedAsset& imported);

/// `file` and `kind`, then what the file's format says and describe_asset(). The kind is "asset" for a skinned mesh,
/// "mesh" and "points" without a rig, "rig" for a mesh beside a skeleton that does not move it, "skeleton" and "motion"
/// without a mesh.
Json describe_geometry(const std::filesystem::path& path, const Geometry& geometry);

/// The description of a file or folder with its `file` and `kind` first.
Json inspect(const std::filesystem::path& path);

/// Any JSON as indented lines "key: value" for people; lists of plain values stay on one line.
std::string to_text(const Json& description);

}  // namespace anigen::eval
