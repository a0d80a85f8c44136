#pragma once
#include <filesystem>
#include <string>
#include <vector>

namespace anigen::io {

/// How the bytes of a rigged asset are to be read.
enum class RigFormat { kGltf, kAssimp, kTextRig, kRigArrays, kArticulationXl, kAnymate, kDataset };

const char* name_of(RigFormat format);  ///< "gltf", "assimp", "text_rig", "rig_arrays", "articulation_xl", …
/// @throws InputError for another word
RigFormat parse_rig_format(const std::string& word);

/// One asset on disk: enough to read it again in another process.
struct RigEntry {
  RigFormat format = RigFormat::kGltf;
  std::filesystem::path file;  ///< for kDataset the dataset's folder
  std::string key;             ///< the sample inside the file: uuid, name or id; empty for files with one asset
  /// Below the folder that was listed, with '/'; samples of a shard as "<path>#<key>". For a dataset's asset what its
  /// metadata.csv says, for a posed variant there its id.
  std::string local_path;
  bool is_test = false;   ///< the source says so: is_test of a dataset, a shard called "…test"
  std::string uuid = "";  ///< what the sample is called in its shard, now or when the dataset was made; or empty
};

/// Every rigged asset that a file or folder holds; formats may be mixed, folders of any depth:
///   - .glb, .gltf; .fbx and .dae (Assimp);
///   - text rigs, each with its .obj (text_rig.h); other .txt files are no rigs;
///   - .npz with plain arrays (rig_arrays.h) or with Articulation-XL samples, .pt and .pth with Anymate samples;
///   - a published dataset, told by metadata.csv beside skeleton/: then nothing else in that folder is looked at.
/// Sorted by path, samples in the order of their file. Links to folders are not followed.
/// A damaged shard in a folder is listed as one asset, which then cannot be read.
/// @throws InputError when there is nothing of that, metadata.csv is damaged, or a file named by itself is damaged or
/// none of these
std::vector<RigEntry> list_rigs(const std::filesystem::path& path);

}  // namespace anigen::io
