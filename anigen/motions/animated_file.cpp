#include "anigen/motions/animated_file.h"

#include <algorithm>
#include <set>
#include <utility>

#include "anigen/core/error.h"
#include "anigen/io/gltf/add_animations.h"
#include "anigen/io/rigs/read_assimp.h"
#include "anigen/io/rigs/rig_listing.h"
#include "anigen/io/write_rigged.h"

namespace anigen::motions {

const std::vector<std::string>& animated_extensions() {
  static const std::vector<std::string> all = {".glb", ".gltf", ".fbx", ".dae"};
  return all;
}

io::ImportedAsset read_animated(const std::filesystem::path& file) {
  io::require_content(file);
  if (!io::has_extension(file, animated_extensions()))
    throw InputError(file.string(), "", "a rigged asset is a .glb, .gltf, .fbx or .dae");
  io::ImportOptions options;
  options.require_rig = false;
  const bool is_gltf = io::has_extension(file, {".glb", ".gltf"});
  io::ImportedAsset read = is_gltf ? io::read_gltf(file, options) : io::read_assimp(file, options);
  read.asset.name = file.filename().string();
  return read;
}

bool write_animated(const std::filesystem::path& original, Asset& asset, const std::vector<Animation>& clips,
                    bool keep_clips, const std::filesystem::path& out, std::vector<std::string>& notes) {
  const std::vector<std::string> gltf = {".glb", ".gltf"};
  if (io::has_extension(original, gltf) && io::has_extension(out, gltf)) {
    try {
      io::AddAnimationOptions options;
      options.keep_clips = keep_clips;
      for (const io::ImportNote& note : io::add_animations(original, clips, out, options))
        notes.push_back(note.message);
      return true;
    } catch (const NotSupportedError& error) {
      notes.push_back("written anew with base colour alone: " + std::string(error.what()));
    }
  } else {
    notes.emplace_back("written anew with base colour alone");
  }
  if (!keep_clips) asset.animations.clear();
  std::set<std::string> taken;
  for (const Animation& clip : asset.animations) taken.insert(clip.name);
  for (Animation clip : clips) {
    const std::string name = clip.name;
    for (int k = 2; !taken.insert(clip.name).second; ++k) clip.name = name + "_" + std::to_string(k);
    asset.animations.push_back(std::move(clip));
  }
  io::ExportOptions options;
  options.influences = std::max<std::size_t>(4, asset.skin.largest_row());
  io::write_rigged(out, asset, options);
  return false;
}

}  // namespace anigen::motions
