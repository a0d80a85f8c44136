#pragma once
#include <string>
#include <vector>

#include "anigen/asset/rigged_asset.h"
#include "anigen/core/job.h"

namespace anigen::engine {

struct AnimateOptions {
  /// Words of motion_words(), or FILE or FILE#CLIP with a .bvh, .fbx, .dae, .glb or .gltf.
  std::vector<std::string> motions = {"idle"};
  double fps = 30.0;    ///< key frames per second
  int frames = 0;       ///< key frames of each clip in place of fps; 0: by fps
  double speed = 1.0;   ///< factor on how fast a motion runs
  bool travel = false;  ///< walk, run, swim, fly and slither go forward
};

/// Clips for a rigged asset, in the order of the motions. Their names differ from those of the asset's own clips: clear
/// these first to replace them. @throws InputError for a motion that is unknown or that the body cannot do, which names
/// those that it can, and for options out of their ranges; Interrupted
std::vector<Animation> animate(const Asset& asset, const AnimateOptions& options = {}, Job* job = nullptr);

/// Motions that are built in.
std::vector<std::string> motion_words();

/// Those that a body can do. @throws InputError without a skin
std::vector<std::string> motions_of(const Asset& asset);

}  // namespace anigen::engine
