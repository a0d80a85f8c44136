#include "anigen/eval/motion/motion_file.h"

#include <filesystem>
#include <utility>

#include "anigen/core/atomic_file.h"
#include "anigen/core/error.h"
#include "anigen/core/sha256.h"
#include "anigen/io/gltf.h"
#include "anigen/io/rigs/assimp_scene.h"
#include "anigen/io/rigs/bvh.h"
#include "anigen/io/rigs/file_list.h"

namespace anigen::eval {
namespace {

namespace fs = std::filesystem;

struct Clips {
  Skeleton skeleton;
  std::vector<Animation> animations;
};

Clips read_clips(const fs::path& file) {
  io::require_content(file);
  const std::string extension = io::lower_extension(file);
  if (extension == ".bvh") {
    io::BvhMotion read = io::read_bvh(file);
    return {std::move(read.skeleton), {std::move(read.animation)}};
  }
  const bool is_gltf = extension == ".glb" || extension == ".gltf";
  if (!is_gltf && extension != ".fbx" && extension != ".dae")
    throw InputError(file.string(), "", "a motion is a .bvh, .glb, .gltf, .fbx or .dae");
  io::ImportOptions options;
  options.require_rig = false;  // clips of motion libraries come without a mesh
  Asset asset = (is_gltf ? io::read_gltf(file, options) : io::read_assimp(file, options)).asset;
  if (asset.animations.empty()) throw InputError(file.string(), "", "there is no clip in it");
  return {std::move(asset.skeleton), std::move(asset.animations)};
}

const Animation& named_clip(const Clips& clips, const std::string& wanted, const fs::path& file) {
  for (const Animation& animation : clips.animations) {
    if (animation.name == wanted) return animation;
  }
  std::string known;
  for (std::size_t i = 0; i < clips.animations.size(); ++i) {
    if (std::to_string(i) == wanted) return clips.animations[i];
    known += (i > 0 ? ", '" : "'") + clips.animations[i].name + "'";
  }
  throw InputError(file.string(), "clip '" + wanted + "'", "there is no such clip; there are " + known);
}

/// A file name may hold the sign, too.
std::pair<fs::path, std::string> file_and_clip_of(const std::string& text) {
  std::error_code ignored;
  const std::size_t sign = text.rfind('#');
  if (sign == std::string::npos || fs::exists(text, ignored)) return {text, ""};
  return {text.substr(0, sign), text.substr(sign + 1)};
}

}  // namespace

Motion first_moving_clip(const std::vector<Animation>& animations, const Skeleton& skeleton, int frames) {
  for (const Animation& animation : animations) {
    Motion motion = motion_of(animation, skeleton, frames);
    if (moves(motion)) return motion;
  }
  return {};
}

MotionFile read_motion(const std::string& file_and_clip, int frames) {
  const auto [file, clip] = file_and_clip_of(file_and_clip);
  const Clips clips = read_clips(file);
  MotionFile result;
  if (clip.empty()) {
    result.motion = first_moving_clip(clips.animations, clips.skeleton, frames);
  } else {
    result.motion = motion_of(named_clip(clips, clip, file), clips.skeleton, frames);
    if (!moves(result.motion)) result.motion.frames.clear();
  }
  if (result.motion.frames.empty())
    throw InputError(file.string(), clip.empty() ? "" : "clip '" + clip + "'", "nothing moves in it");
  result.described = {{"file", file.string()},
                      {"sha256", sha256(read_file(file))},
                      {"clip", result.motion.name},
                      {"joints", result.motion.joints.size()}};
  return result;
}

}  // namespace anigen::eval
